"""What a sensor file may say: its keys, its numbers, the pad's surface, the mesh, the optics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Any

from sim.scene.pad import SurfacePad, read_surface_pad
from sim.scene.triangle_file import MeshUnit
from tacauchy_rig.errors import ConfigError, naming
from tacauchy_rig.quantities import Dimension, parse_quantity

MATERIAL = {"young": Dimension.PRESSURE, "poisson": Dimension.RATIO}
DIMENSIONS = {
    "pad": dict.fromkeys(
        ("size_x", "size_y", "height", "dome_radius_x", "dome_radius_y"), Dimension.LENGTH
    ),
    "material": MATERIAL,
    "camera": dict.fromkeys(("pixel_x", "pixel_y", "centre_x", "centre_y"), Dimension.LENGTH),
    "markers": dict.fromkeys(("pitch_x", "pitch_y", "radius"), Dimension.LENGTH),
}
_COUNTS = {"camera": ("width", "height"), "markers": ("columns", "rows")}
_PLAIN = {"camera": ("crop",)}
_OPTIONAL = {"pad.dome_radius_x", "pad.dome_radius_y"}
SURFACE_KEYS = ("surface", "unit", "source")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A number of a sensor file, SI, with its standard uncertainty and where it is from."""

    value: float
    uncertainty: float
    source: str


def refuse_unknown(data: dict[str, Any], origin: str) -> None:
    """Refuse a file with a key that means nothing, or without one that it needs.

    Raises:
        ConfigError: The message names the keys.
    """
    known = {"name", "title", "lamps", "layers", "optics", "mesh", *DIMENSIONS}
    keys = [key for key in data if key not in known]
    for section, dimensions in DIMENSIONS.items():
        allowed = {*dimensions, *_COUNTS.get(section, ()), *_PLAIN.get(section, ())}
        if section == "pad" and "surface" in data.get("pad", {}):
            allowed = set(SURFACE_KEYS)
        keys += [f"{section}.{key}" for key in data.get(section, {}) if key not in allowed]
    missing = [key for key in ("name", "title", "pad", "camera") if key not in data]
    if keys:
        raise ConfigError(
            f"{origin}: unknown {', '.join(keys)}", remedy="remove it or correct its spelling"
        )
    if missing:
        raise ConfigError(f"{origin}: no {', '.join(missing)}", remedy="add what is missing")
    if ("material" in data) == ("layers" in data):
        found = "both material and layers" if "material" in data else "neither material nor layers"
        raise ConfigError(
            f"{origin}: {found}",
            remedy="give [material] for a gel of one material, else one [[layers]] a layer",
        )


def read_numbers(data: dict[str, Any], origin: str) -> dict[str, Measured]:
    """Return the numbers of every section by their dotted names; layers are left out.

    Raises:
        ConfigError: A number is missing, or lacks its unit, uncertainty or source.
    """
    found: dict[str, Measured] = {}
    for section, dimensions in DIMENSIONS.items():
        if section not in data or "surface" in data[section]:
            continue
        for key, dimension in dimensions.items():
            name = f"{section}.{key}"
            if key in data[section]:
                found[name] = read_number(data[section][key], f"{origin}: {name}", dimension)
            elif name not in _OPTIONAL:
                raise ConfigError(f"{origin}: no {name}", remedy="add it")
    return found


def read_number(entry: Any, name: str, dimension: Dimension) -> Measured:
    """Return one number.

    Raises:
        ConfigError: It lacks its unit, uncertainty or source.
    """
    if not isinstance(entry, dict) or set(entry) != {"value", "uncertainty", "source"}:
        raise ConfigError(
            f"{name} needs a value, an uncertainty and a source",
            remedy='write { value = "4 mm", uncertainty = "0.1 mm", source = "measured" }',
        )
    value, uncertainty = (
        parse_quantity(str(entry[part]), dimension=dimension, field=f"{name}.{part}")
        for part in ("value", "uncertainty")
    )
    return Measured(value=value, uncertainty=uncertainty, source=str(entry["source"]))


def read_counts(data: dict[str, Any], origin: str) -> dict[str, int]:
    """Return the whole numbers by their dotted names.

    Raises:
        ConfigError: One is missing or below 1.
    """
    found: dict[str, int] = {}
    for section, keys in _COUNTS.items():
        for key in keys if section in data else ():
            count = data[section].get(key)
            if not isinstance(count, int) or count < 1:
                raise ConfigError(
                    f"{origin}: {section}.{key} = {count!r} is not a whole number above 0",
                    remedy="give a count such as 320",
                )
            found[f"{section}.{key}"] = count
    return found


def surface_of(table: Mapping[str, Any], *, origin: str, folder: Path) -> SurfacePad:
    """Read ``surface = "gel.stl"``, ``unit = "mm"`` and ``source`` of ``[pad]``.

    Args:
        origin: The sensor file, for messages.
        folder: Where a relative path starts.

    Raises:
        ConfigError: A key is missing or wrong, or the file bounds no pad.
    """
    missing = [key for key in SURFACE_KEYS if not str(table.get(key, "")).strip()]
    if missing:
        raise ConfigError(
            f"{origin}: pad has a surface but no {', '.join(missing)}",
            remedy='write surface = "gel.stl", unit = "mm", source = "where it is from"',
        )
    unit = str(table["unit"])
    if unit not in set(MeshUnit):
        raise ConfigError(
            f"{origin}: pad.unit = {unit!r} is no unit", remedy=f"one of: {', '.join(MeshUnit)}"
        )
    with naming(origin):
        return read_surface_pad(folder / str(table["surface"]), unit=MeshUnit(unit))


class OpticsKind(StrEnum):
    """What a sensor's image shows: the slope of the gel in colours, or its depth in grey."""

    PHOTOMETRIC = "photometric"
    GREY_DEPTH = "grey-depth"


@dataclass(frozen=True, slots=True, kw_only=True)
class Lamp:
    """A lamp beside the gel, as far as its maker's drawings tell; calibration replaces it.

    Attributes:
        azimuth_rad: Where it stands, from growing columns towards growing rows [rad].
        elevation_rad: Angle of its light to the unloaded surface [rad].
        colour: Grey levels that it adds to red, green and blue of a surface that faces it.
    """

    azimuth_rad: float
    elevation_rad: float
    colour: tuple[float, float, float]

    @property
    def towards(self) -> tuple[float, float, float]:
        """Direction to it along columns, rows and up, of length 1."""
        level = math.cos(self.elevation_rad)
        return (
            level * math.cos(self.azimuth_rad),
            level * math.sin(self.azimuth_rad),
            math.sin(self.elevation_rad),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptics:
    """How a sensor turns its gel's surface into an image.

    Attributes:
        lamps: Nominal lamps; empty where none are known.
        shadow_softness_m: Height over which a shadow's edge turns from light to dark [m]; None
            where the sensor shows no shadows.
        grey_depth_m: Rising indentations of the table of grey levels [m]; empty if photometric.
        grey_change: Change of the grey level at each, same length.
    """

    kind: OpticsKind = OpticsKind.PHOTOMETRIC
    lamps: tuple[Lamp, ...] = ()
    shadow_softness_m: float | None = None
    grey_depth_m: tuple[float, ...] = ()
    grey_change: tuple[float, ...] = ()


_TABLE_KEYS = {
    OpticsKind.PHOTOMETRIC: ({"kind"}, {"shadow_softness", "source"}),
    OpticsKind.GREY_DEPTH: ({"kind", "depth", "change", "source"}, set()),
}


def parse_optics(data: dict[str, Any], origin: str) -> SensorOptics:
    """Read ``[optics]`` and ``[[lamps]]``; ``origin`` names the file in messages.

    Raises:
        ConfigError: A key is unknown or missing, or the table of grey levels does not rise.
    """
    lamps = _lamps(data.get("lamps", []), origin)
    table = data.get("optics", {"kind": OpticsKind.PHOTOMETRIC.value})
    try:
        kind = OpticsKind(table.get("kind", ""))
    except ValueError as error:
        raise ConfigError(
            f"{origin}: optics.kind is {table.get('kind')!r}",
            remedy=f"one of: {', '.join(OpticsKind)}",
        ) from error
    needed, optional = _TABLE_KEYS[kind]
    wrong = sorted((needed - set(table)) | (set(table) - needed - optional))
    if wrong:
        raise ConfigError(
            f"{origin}: optics of kind {kind}: missing or unknown {', '.join(wrong)}",
            remedy=f"give {', '.join(sorted(needed | optional))}",
        )
    if kind is OpticsKind.GREY_DEPTH:
        depth, change = _grey_table(table, origin)
        return SensorOptics(kind=kind, lamps=lamps, grey_depth_m=depth, grey_change=change)
    return SensorOptics(kind=kind, lamps=lamps, shadow_softness_m=_softness(table, lamps, origin))


def _softness(table: dict[str, Any], lamps: tuple[Lamp, ...], origin: str) -> float | None:
    if "shadow_softness" not in table:
        return None
    name = f"{origin}: optics.shadow_softness"
    value = parse_quantity(str(table["shadow_softness"]), dimension=Dimension.LENGTH, field=name)
    if not value > 0.0 or not lamps:
        raise ConfigError(
            f"{name} needs a positive length and at least one lamp that casts the shadow",
            remedy='write shadow_softness = "0.05 mm" and [[lamps]], or leave it out',
        )
    return value


def _grey_table(table: dict[str, Any], origin: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    depth = tuple(
        parse_quantity(str(entry), dimension=Dimension.LENGTH, field=f"{origin}: optics.depth")
        for entry in table["depth"]
    )
    change = tuple(float(level) for level in table["change"])
    rising = all(a < b for a, b in pairwise(depth))
    if len(depth) < 2 or len(depth) != len(change) or depth[0] != 0.0 or not rising:
        raise ConfigError(
            f"{origin}: optics.depth and optics.change are no table",
            remedy='write depth = ["0 mm", "0.5 mm", "1 mm"] and change = [0, -40, -60], rising '
            "from 0 mm",
        )
    return depth, change


def _lamps(entries: list[dict[str, Any]], origin: str) -> tuple[Lamp, ...]:
    found = []
    for number, entry in enumerate(entries, start=1):
        name = f"{origin}: lamp {number}"
        if set(entry) != {"azimuth", "elevation", "colour", "source"}:
            raise ConfigError(
                f"{name} needs azimuth, elevation, colour and source",
                remedy='write azimuth = "90 deg", elevation = "20 deg", colour = [80, 0, 0]',
            )
        azimuth, elevation = (
            parse_quantity(entry[key], dimension=Dimension.ANGLE, field=f"{name} {key}")
            for key in ("azimuth", "elevation")
        )
        red, green, blue = (float(level) for level in entry["colour"])
        found.append(Lamp(azimuth_rad=azimuth, elevation_rad=elevation, colour=(red, green, blue)))
    return tuple(found)
