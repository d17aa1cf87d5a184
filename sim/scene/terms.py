"""Pads, layers and indenters as text: ``box:20.75x25.25x4.5mm``, ``cylinder:diameter=5mm``."""

from __future__ import annotations

from pathlib import Path

from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Plane, Sphere, read_mesh_indenter
from sim.scene.material import Layer, Material
from sim.scene.pad import BoxPad, DiscPad, Pad, SurfacePad, read_surface_pad
from sim.scene.scene import ContactMode, Effect
from sim.scene.triangle_file import MeshUnit
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity
from tacauchy_rig.registry import Kind, load, names, unknown


def parse_pad(text: str) -> Pad:
    """Read ``box:LxWxHmm``, ``disc:radius=...,height=...`` or ``mesh:FILE,unit=...``.

    Raises:
        ConfigError: Another shape, a size that is missing or has no length unit, or a mesh that
            bounds no pad.
    """
    kind, _, sizes = text.partition(":")
    if kind == "box":
        return _box(sizes)
    if kind == "disc":
        given = _lengths(sizes, needed=("radius", "height"), field="--pad disc")
        return DiscPad(radius_m=given["radius"], height_m=given["height"])
    if kind == "mesh":
        return _surface(sizes)
    raise ConfigError(
        f"--pad {text!r}: no such pad",
        remedy="write box:20.75x25.25x4.5mm, disc:radius=12mm,height=4.5mm or "
        "mesh:gel.stl,unit=mm, or use --sensor",
    )


def _surface(text: str) -> SurfacePad:
    """Read ``FILE,unit=``; what the file is measured in must be said."""
    file, _, unit = text.partition(",unit=")
    if unit not in set(MeshUnit):
        raise ConfigError(
            f"--pad mesh:{text}: {f'no such unit {unit!r}' if unit else 'its unit is not said'}",
            remedy=f"write mesh:gel.stl,unit=mm; units are {', '.join(MeshUnit)}",
        )
    return read_surface_pad(Path(file), unit=MeshUnit(unit))


def _box(sizes: str) -> BoxPad:
    parts = sizes.split("x")
    if len(parts) != 3:
        raise ConfigError(
            f"--pad box:{sizes}: needs three sizes", remedy="write box:20.75x25.25x4.5mm"
        )
    x, y, height = _with_one_unit(parts, Dimension.LENGTH, "--pad box")
    return BoxPad(size_x_m=x, size_y_m=y, height_m=height)


def parse_layer(text: str, *, law: str) -> Layer:
    """Read ``share=0.925,young=0.1MPa,poisson=0.48``.

    Raises:
        ConfigError: One of the three is missing, unknown or no number.
    """
    wanted = {
        "share": Dimension.RATIO,
        "young": Dimension.PRESSURE,
        "poisson": Dimension.RATIO,
    }
    given = dict(part.partition("=")[::2] for part in text.split(","))
    if set(given) != set(wanted):
        raise ConfigError(
            f"--layer {text!r} does not give share, young and poisson, once each",
            remedy="write --layer share=0.925,young=0.1MPa,poisson=0.48, from the base upwards",
        )
    share, young, poisson = (
        parse_quantity(given[name], dimension=dimension, field=f"--layer {name}")
        for name, dimension in wanted.items()
    )
    return Layer(share=share, material=Material(young_pa=young, poisson=poisson, law=law))


def parse_indenter(text: str) -> Indenter:
    """Read ``KIND:SIZES``: ours, or a kind that another package brings.

    Raises:
        ConfigError: Another shape, a size that is missing or has no length unit, or a mesh that
            bounds no body.
    """
    kind, _, sizes = text.partition(":")
    if unknown(Kind.INDENTER, kind):
        ours = "cylinder:diameter=5mm", "sphere:diameter=15mm", "plane", "mesh:part.stl,unit=mm"
        brought = names(Kind.INDENTER)[len(ours) :]
        raise ConfigError(
            f"--indenter {text!r}: no such indenter",
            remedy=f"write {', '.join([*ours[:-1], *brought])} or {ours[-1]}",
        )
    indenter: Indenter = load(Kind.INDENTER, kind)(sizes)
    return indenter


def parse_cylinder(sizes: str) -> Cylinder:
    """Read ``diameter=[,fillet=]``."""
    given = _lengths(sizes, needed=("diameter",), allowed=("fillet",), field="--indenter cylinder")
    return Cylinder(diameter_m=given["diameter"], fillet_m=given.get("fillet", 0.0))


def parse_sphere(sizes: str) -> Sphere:
    """Read ``diameter=``."""
    return Sphere(
        diameter_m=_lengths(sizes, needed=("diameter",), field="--indenter sphere")["diameter"]
    )


def parse_plane(_sizes: str) -> Plane:
    """Return a plate, which has no size."""
    return Plane()


def parse_mesh(text: str) -> MeshIndenter:
    """Read ``FILE[,unit=]``; triangle files name no unit, so millimetres are assumed."""
    file, _, unit = text.partition(",unit=")
    if unit and unit not in set(MeshUnit):
        raise ConfigError(
            f"--indenter mesh: no such unit {unit!r}", remedy=f"one of: {', '.join(MeshUnit)}"
        )
    return read_mesh_indenter(Path(file), unit=MeshUnit(unit or MeshUnit.MILLIMETRE))


def parse_contact(text: str) -> tuple[ContactMode, float]:
    """Read ``frictionless``, ``bonded`` or ``friction:MU``; mu is zero for the first two.

    Raises:
        ConfigError: Another contact, or a coefficient that is missing or negative.
    """
    name, _, coefficient = text.partition(":")
    remedy = "write frictionless, bonded or friction:0.5"
    try:
        mode = ContactMode(name)
        friction = float(coefficient) if mode is ContactMode.FRICTION else 0.0
    except ValueError as error:
        raise ConfigError(f"--contact {text!r}: no such contact", remedy=remedy) from error
    if not 0.0 <= friction < float("inf"):
        raise ConfigError(f"--contact {text!r}: mu is not 0 or above", remedy=remedy)
    return mode, friction


def parse_pair(text: str | None, dimension: Dimension, field: str) -> tuple[float, float]:
    """Read one quantity, for x alone, or two with one unit: ``0.3mm``, ``0.3,-0.1mm``.

    Raises:
        ConfigError: More than two, or no unit of the dimension.
    """
    if text is None:
        return 0.0, 0.0
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > 2:
        raise ConfigError(f"{field} {text!r}: more than x and y", remedy="write 0.3,0.1mm")
    values = [*_with_one_unit(parts, dimension, field), 0.0]
    return values[0], values[1]


def _with_one_unit(parts: list[str], dimension: Dimension, field: str) -> list[float]:
    """Read numbers of which only the last must say its unit."""
    unit = parts[-1].lstrip("+-.0123456789eE ")
    given = [part if part.endswith(unit) else part + unit for part in parts]
    return [parse_quantity(part, dimension=dimension, field=field) for part in given]


def parse_switch(text: str) -> tuple[Effect, bool]:
    """Read ``friction=on`` or ``friction=off``.

    Raises:
        ConfigError: No such effect, or neither on nor off.
    """
    name, _, state = text.partition("=")
    names = [effect.value for effect in Effect]
    if name not in names:
        raise ConfigError(f"--effect {text!r}: no such effect", remedy=f"one of {', '.join(names)}")
    if state not in ("on", "off"):
        raise ConfigError(f"--effect {text!r}: neither on nor off", remedy=f"write {name}=on")
    return Effect(name), state == "on"


def _lengths(
    text: str, *, needed: tuple[str, ...], field: str, allowed: tuple[str, ...] = ()
) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in filter(None, text.split(",")):
        name, _, value = part.partition("=")
        if name not in (*needed, *allowed):
            raise ConfigError(
                f"{field}: unknown size {name!r}",
                remedy=f"sizes are: {', '.join((*needed, *allowed))}",
            )
        found[name] = parse_quantity(value, dimension=Dimension.LENGTH, field=f"{field} {name}")
    missing = [name for name in needed if name not in found]
    if missing:
        raise ConfigError(f"{field}: no {', '.join(missing)}", remedy=f"add {missing[0]}=5mm")
    return found
