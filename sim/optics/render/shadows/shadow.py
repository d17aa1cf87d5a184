"""Shadows that the pressed gel casts on itself, for sensors whose file asks for them.

A lamp at the gel's side grazes it; what bulges towards the camera hides the lamp from the gel
behind it. What counts is the highest thing over each pixel's ray to the lamp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.optics.camera_geometry import CameraGeometry
from sim.optics.height.tilt import Float32Array
from sim.optics.render.nominal import Lamp
from sim.optics.render.shadows.horizon import Sweep, rise_over, sweep_towards

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

    def as_json(self) -> dict[str, Any]:
        """Return plain values, units in the keys, for a calibration's provenance."""
        return {"lamps": [asdict(lamp) for lamp in self.lamps], "softness_m": self.softness_m}

    def darkening(
        self,
        indentation_m: NDArray[np.floating],
        tilt: Float32Array,
        geometry: CameraGeometry,
    ) -> Float32Array:
        """Return the light taken away [grey levels, not positive], shape [3, height, width].

        Args:
            indentation_m: Unloaded minus loaded height [m], of the geometry's size.
            tilt: Of the loaded gel, shape [2, ...] of the same.
            geometry: Pixels.
        """
        bulge = np.asarray(indentation_m, dtype=np.float32)
        taken = np.zeros((3, *bulge.shape), dtype=np.float32)
        for lamp in self.lamps:
            share = lost_share(bulge, tilt, lamp, geometry, softness_m=self.softness_m)
            for channel, level in enumerate(lamp.colour):
                taken[channel] -= np.float32(level) * share
        return taken


def read_shadows(provenance: Mapping[str, Any]) -> ShadowCaster | None:
    """Return the lamps that a calibration's provenance names; None where it names none."""
    plain = provenance.get(SHADOWS)
    if not isinstance(plain, Mapping):
        return None
    lamps = [Lamp(**{**lamp, "colour": tuple(lamp["colour"])}) for lamp in plain["lamps"]]
    return ShadowCaster(lamps=lamps, softness_m=float(plain["softness_m"]))


def lost_share(
    bulge: Float32Array,
    tilt: Float32Array,
    lamp: Lamp,
    geometry: CameraGeometry,
    *,
    softness_m: float,
) -> Float32Array:
    """Return the share of a lamp's colour that a dent takes away, shape [height, width].

    Args:
        bulge: Unloaded minus loaded height [m], shape [height, width].
        tilt: Of the loaded gel, shape [2, height, width].
        lamp: Its colour does not count.
        geometry: Pixels.
        softness_m: Height by which the gel must reach over a ray to hide the lamp whole [m].
    """
    facing = (
        math.cos(lamp.elevation_rad)
        * (math.cos(lamp.azimuth_rad) * tilt[0] + math.sin(lamp.azimuth_rad) * tilt[1])
    ) + math.sin(lamp.elevation_rad) * np.sqrt(1.0 - tilt[0] ** 2 - tilt[1] ** 2)
    hidden = _hidden(bulge, lamp, geometry, softness_m)
    return np.asarray(hidden * np.maximum(facing, 0.0), dtype=np.float32)


def rise_in_a_step_m(lamp: Lamp, sweep: Sweep, geometry: CameraGeometry) -> float:
    """Return by how much a ray to a lamp rises in a step of a sweep [m]."""
    return math.tan(lamp.elevation_rad) * geometry.mean_scale_m * sweep.step_px


def _hidden(
    bulge: Float32Array, lamp: Lamp, geometry: CameraGeometry, softness_m: float
) -> Float32Array:
    """Return how much of the lamp is hidden, 0 to 1, shape [height, width]."""
    sweep = sweep_towards(lamp.azimuth_rad, bulge.shape)
    over = rise_over(bulge, sweep, rise_in_a_step_m(lamp, sweep, geometry))
    return np.asarray(np.clip(over / np.float32(softness_m), 0.0, 1.0))
