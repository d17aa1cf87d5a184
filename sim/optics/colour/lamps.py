"""The lamps around a gel that a pressed gel throws shadows of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sim.sensor.tables import Lamp

SHADOWS = "shadows"  # its name in a calibration's provenance


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadowCaster:
    """Lamps that cast shadows, and how soft those are.

    Attributes:
        lamps: As the sensor's file has them.
        softness_m: Height by which the gel must reach over a ray to hide the lamp whole [m].
    """

    lamps: Sequence[Lamp]
    softness_m: float


def read_shadows(provenance: Mapping[str, Any]) -> ShadowCaster | None:
    """Return the lamps that a calibration's provenance names; None where it names none."""
    plain = provenance.get(SHADOWS)
    if not isinstance(plain, Mapping):
        return None
    lamps = [Lamp(**{**lamp, "colour": tuple(lamp["colour"])}) for lamp in plain["lamps"]]
    return ShadowCaster(lamps=lamps, softness_m=float(plain["softness_m"]))
