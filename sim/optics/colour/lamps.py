"""Lamps around a gel, and those of them that a pressed gel throws shadows of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

SHADOWS = "shadows"  # its name in a calibration's provenance


@dataclass(frozen=True, slots=True, kw_only=True)
class Lamp:
    """A far lamp of one colour.

    Attributes:
        azimuth_rad: Direction in which it stands, from growing columns towards growing rows [rad].
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
class ShadowCaster:
    """Lamps that cast shadows, and how soft those are.

    Attributes:
        lamps: As the sensor's file has them.
        softness_m: Height by which the gel must reach over a ray to hide the lamp whole [m].
    """

    lamps: Sequence[Lamp]
    softness_m: float

    def as_json(self) -> dict[str, Any]:
        """Return plain values, units in the keys, for a calibration's provenance."""
        return {"lamps": [asdict(lamp) for lamp in self.lamps], "softness_m": self.softness_m}


def read_shadows(provenance: Mapping[str, Any]) -> ShadowCaster | None:
    """Return the lamps that a calibration's provenance names; None where it names none."""
    plain = provenance.get(SHADOWS)
    if not isinstance(plain, Mapping):
        return None
    lamps = [Lamp(**{**lamp, "colour": tuple(lamp["colour"])}) for lamp in plain["lamps"]]
    return ShadowCaster(lamps=lamps, softness_m=float(plain["softness_m"]))
