"""Pads, layers and indenters as text: ``box:20.75x25.25x4.5mm``, ``cylinder:diameter=5mm``."""

from __future__ import annotations

from sim.indenter import Cylinder, Indenter, Plane, Sphere
from sim.laws.catalogue import LawName
from sim.pad import BoxPad, DiscPad, Pad
from sim.scene import ContactMode, Layer, Material
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity


def parse_pad(text: str) -> Pad:
    """Read ``box:LxWxHmm`` or ``disc:radius=...,height=...``.

    Raises:
        ConfigError: Another shape, or a size that is missing or has no length unit.
    """
    kind, _, sizes = text.partition(":")
    if kind == "box":
        return _box(sizes)
    if kind == "disc":
        given = _lengths(sizes, needed=("radius", "height"), field="--pad disc")
        return DiscPad(radius_m=given["radius"], height_m=given["height"])
    raise ConfigError(
        f"--pad {text!r}: no such pad",
        remedy="write box:20.75x25.25x4.5mm or disc:radius=12mm,height=4.5mm, or use --sensor",
    )


def _box(sizes: str) -> BoxPad:
    parts = sizes.split("x")
    if len(parts) != 3:
        raise ConfigError(
            f"--pad box:{sizes}: needs three sizes", remedy="write box:20.75x25.25x4.5mm"
        )
    unit = parts[2].lstrip("+-.0123456789 ")
    x, y, height = (
        parse_quantity(
            part if part.endswith(unit) else part + unit,
            dimension=Dimension.LENGTH,
            field="--pad box",
        ).value
        for part in parts
    )
    return BoxPad(size_x_m=x, size_y_m=y, height_m=height)


def parse_layer(text: str, *, law: LawName) -> Layer:
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
        parse_quantity(given[name], dimension=dimension, field=f"--layer {name}").value
        for name, dimension in wanted.items()
    )
    return Layer(share=share, material=Material(young_pa=young, poisson=poisson, law=law))


def parse_indenter(text: str) -> Indenter:
    """Read ``cylinder:diameter=[,fillet=]``, ``sphere:diameter=`` or ``plane``.

    Raises:
        ConfigError: Another shape, or a size that is missing or has no length unit.
    """
    kind, _, sizes = text.partition(":")
    match kind:
        case "cylinder":
            given = _lengths(
                sizes, needed=("diameter",), allowed=("fillet",), field="--indenter cylinder"
            )
            return Cylinder(diameter_m=given["diameter"], fillet_m=given.get("fillet", 0.0))
        case "sphere":
            given = _lengths(sizes, needed=("diameter",), field="--indenter sphere")
            return Sphere(diameter_m=given["diameter"])
        case "plane":
            return Plane()
        case _:
            raise ConfigError(
                f"--indenter {text!r}: no such indenter",
                remedy="write cylinder:diameter=5mm, sphere:diameter=15mm or plane",
            )


def parse_contact(text: str) -> ContactMode:
    """Read what touching points may do along the indenter.

    Raises:
        ConfigError: Another contact.
    """
    try:
        return ContactMode(text)
    except ValueError as error:
        raise ConfigError(
            f"--contact {text!r}: no such contact",
            remedy=f"one of: {', '.join(mode.value for mode in ContactMode)}",
        ) from error


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
        found[name] = parse_quantity(
            value, dimension=Dimension.LENGTH, field=f"{field} {name}"
        ).value
    missing = [name for name in needed if name not in found]
    if missing:
        raise ConfigError(f"{field}: no {', '.join(missing)}", remedy=f"add {missing[0]}=5mm")
    return found
