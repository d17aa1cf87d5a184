"""Pads, layers and indenters as text: ``box:20.75x25.25x4.5mm``, ``cylinder:diameter=5mm``.

Each reader raises ConfigError, with the option, for a word that it does not know, a number that is
missing, out of range or without its unit, and a mesh that bounds no pad or body.
"""

from collections.abc import Mapping
from pathlib import Path

from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Plane, Sphere, read_mesh_indenter
from sim.scene.material import Layer, Material
from sim.scene.pad import BoxPad, DiscPad, Pad, read_surface_pad
from sim.scene.scene import ContactMode, Effect
from sim.scene.triangle_surface import MeshUnit
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.registry import Kind, load, names, unknown

_ROUND = {"diameter": (Dimension.LENGTH, "5mm")}
_CYLINDER = {**_ROUND, "fillet": (Dimension.LENGTH, "0.3mm")}
_DISC = {"radius": (Dimension.LENGTH, "12mm"), "height": (Dimension.LENGTH, "4.5mm")}
_LAYER = {
    "share": (Dimension.RATIO, "0.925"),
    "young": (Dimension.PRESSURE, "0.1MPa"),
    "poisson": (Dimension.RATIO, "0.48"),
}


@naming("--pad")
def parse_pad(text: str) -> Pad:
    """Read ``box:LxWxHmm``, ``disc:radius=...,height=...`` or ``mesh:FILE,unit=...``."""
    kind, _, sizes = text.partition(":")
    if kind == "box":
        parts = sizes.split("x")
        if len(parts) != 3:
            raise ConfigError(f"{text}: needs three sizes", remedy="write box:20.75x25.25x4.5mm")
        x, y, height = _with_one_unit(parts, Dimension.LENGTH, "box")
        return BoxPad(size_x_m=x, size_y_m=y, height_m=height)
    if kind == "disc":
        given = _sizes(sizes, _DISC, field="disc")
        return DiscPad(radius_m=given["radius"], height_m=given["height"])
    if kind == "mesh":
        file, unit = _file_and_unit(sizes)
        return read_surface_pad(file, unit=unit)
    raise ConfigError(
        f"{text!r}: no such pad",
        remedy="write box:20.75x25.25x4.5mm, disc:radius=12mm,height=4.5mm or "
        "mesh:gel.stl,unit=mm, or use --sensor",
    )


def _file_and_unit(text: str, *, default: str = "") -> tuple[Path, MeshUnit]:
    """Read ``FILE,unit=``: triangle files name no unit."""
    file, _, unit = text.partition(",unit=")
    unit = unit or default
    if unit not in set(MeshUnit):
        raise ConfigError(
            f"mesh:{text}: {f'no such unit {unit!r}' if unit else 'its unit is not said'}",
            remedy=f"write mesh:{file},unit=mm; units are {', '.join(MeshUnit)}",
        )
    return Path(file), MeshUnit(unit)


def parse_layer(text: str, *, law: str) -> Layer:
    """Read ``share=0.925,young=0.1MPa,poisson=0.48``."""
    given = _sizes(text, _LAYER, field="--layer")
    material = Material(young_pa=given["young"], poisson=given["poisson"], law=law)
    return Layer(share=given["share"], material=material)


def parse_indenter(text: str, *, field: str = "--indenter") -> Indenter:
    """Read ``KIND:SIZES``: ours, or a kind that another package brings; errors name the field."""
    kind, _, sizes = text.partition(":")
    if unknown(Kind.INDENTER, kind):
        ours = "cylinder:diameter=5mm", "sphere:diameter=15mm", "plane", "object:hexagon", "mesh:"
        brought = names(Kind.INDENTER)[len(ours) :]
        raise ConfigError(
            f"{field}: {text!r}: no such indenter",
            remedy=f"write {', '.join([*ours[:-1], *brought])} or mesh:part.stl,unit=mm",
        )
    with naming(field):
        indenter: Indenter = load(Kind.INDENTER, kind)(sizes)
    return indenter


def parse_cylinder(sizes: str) -> Cylinder:
    """Read ``diameter=[,fillet=]``."""
    given = _sizes(sizes, _CYLINDER, optional=("fillet",), field="cylinder")
    return Cylinder(diameter_m=given["diameter"], fillet_m=given.get("fillet", 0.0))


def parse_sphere(sizes: str) -> Sphere:
    """Read ``diameter=``."""
    return Sphere(diameter_m=_sizes(sizes, _ROUND, field="sphere")["diameter"])


def parse_plane(_sizes: str) -> Plane:
    """Return a plate, which has no size."""
    return Plane()


def parse_mesh(text: str) -> MeshIndenter:
    """Read ``FILE[,unit=][,edge=]``; triangle files name no unit, so millimetres are assumed."""
    text, _, edge = text.partition(",edge=")
    file, unit = _file_and_unit(text, default=MeshUnit.MILLIMETRE)
    radius_m = parse_quantity(edge or "0mm", dimension=Dimension.LENGTH, field="edge")
    return read_mesh_indenter(file, unit=unit, edge_m=radius_m)


def parse_contact(text: str) -> tuple[ContactMode, float]:
    """Read ``frictionless``, ``bonded`` or ``friction:MU``; mu is zero for the first two."""
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
    """Read one quantity, for x alone, or two with one unit: ``0.3mm``, ``0.3,-0.1mm``."""
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
    """Read ``friction=on`` or ``friction=off``."""
    name, _, state = text.partition("=")
    names = [effect.value for effect in Effect]
    if name not in names:
        raise ConfigError(f"--effect {text!r}: no such effect", remedy=f"one of {', '.join(names)}")
    if state not in ("on", "off"):
        raise ConfigError(f"--effect {text!r}: neither on nor off", remedy=f"write {name}=on")
    return Effect(name), state == "on"


def _sizes(
    text: str,
    known: Mapping[str, tuple[Dimension, str]],
    *,
    field: str,
    optional: tuple[str, ...] = (),
) -> dict[str, float]:
    """Read ``NAME=VALUE,NAME=VALUE``; of each name its dimension, and an example for messages."""
    found: dict[str, float] = {}
    for part in filter(None, text.split(",")):
        name, _, value = part.partition("=")
        if name not in known:
            raise ConfigError(
                f"{field}: unknown size {name!r}", remedy=f"sizes are: {', '.join(known)}"
            )
        found[name] = parse_quantity(value, dimension=known[name][0], field=f"{field} {name}")
    missing = [name for name in known if name not in found and name not in optional]
    if missing:
        example = known[missing[0]][1]
        raise ConfigError(f"{field}: no {', '.join(missing)}", remedy=f"add {missing[0]}={example}")
    return found
