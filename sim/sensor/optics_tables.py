"""The optics tables of a sensor file: lamps, shadows, and grey levels by depth."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Any

from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity


class OpticsKind(StrEnum):
    """What a sensor's image shows: the slope of the gel in colours, or its depth in grey."""

    PHOTOMETRIC = "photometric"
    GREY_DEPTH = "grey-depth"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorLamp:
    """A lamp beside the gel, as far as its maker's drawings tell; calibration replaces it.

    Attributes:
        azimuth_rad: Where it stands, from growing columns towards growing rows [rad].
        elevation_rad: Angle of its light to the unloaded surface [rad].
        colour: Grey levels that it adds to red, green and blue of a surface that faces it.
    """

    azimuth_rad: float
    elevation_rad: float
    colour: tuple[float, float, float]


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
    lamps: tuple[SensorLamp, ...] = ()
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


def _softness(table: dict[str, Any], lamps: tuple[SensorLamp, ...], origin: str) -> float | None:
    if "shadow_softness" not in table:
        return None
    name = f"{origin}: optics.shadow_softness"
    value = parse_quantity(
        str(table["shadow_softness"]), dimension=Dimension.LENGTH, field=name
    ).value
    if not value > 0.0 or not lamps:
        raise ConfigError(
            f"{name} needs a positive length and at least one lamp that casts the shadow",
            remedy='write shadow_softness = "0.05 mm" and [[lamps]], or leave it out',
        )
    return value


def _grey_table(table: dict[str, Any], origin: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    depth = tuple(
        parse_quantity(
            str(entry), dimension=Dimension.LENGTH, field=f"{origin}: optics.depth"
        ).value
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


def _lamps(entries: list[dict[str, Any]], origin: str) -> tuple[SensorLamp, ...]:
    found = []
    for number, entry in enumerate(entries, start=1):
        name = f"{origin}: lamp {number}"
        if set(entry) != {"azimuth", "elevation", "colour", "source"}:
            raise ConfigError(
                f"{name} needs azimuth, elevation, colour and source",
                remedy='write azimuth = "90 deg", elevation = "20 deg", colour = [80, 0, 0]',
            )
        azimuth, elevation = (
            parse_quantity(entry[key], dimension=Dimension.ANGLE, field=f"{name} {key}").value
            for key in ("azimuth", "elevation")
        )
        red, green, blue = (float(level) for level in entry["colour"])
        found.append(
            SensorLamp(azimuth_rad=azimuth, elevation_rad=elevation, colour=(red, green, blue))
        )
    return tuple(found)
