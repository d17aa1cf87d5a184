"""Shadows that the pressed gel casts on itself, for sensors whose file asks for them.

A lamp at the gel's side grazes it; what bulges towards the camera hides the lamp from the gel
behind it. Each pixel looks along the lamp's direction for the highest thing above its ray.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.optics.geometry import CameraGeometry
from sim.optics.nominal import Lamp
from sim.optics.tilt import Float32Array

_STEPS_AT_MOST = 96


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadowCaster:
    """Lamps that cast shadows, and how soft those are.

    Attributes:
        lamps: As the sensor's file has them.
        softness_m: Height by which the gel must reach over a ray to hide the lamp whole [m].
    """

    lamps: Sequence[Lamp]
    softness_m: float

    def darkening(
        self,
        indentation_m: NDArray[np.floating],
        tilt: Float32Array,
        geometry: CameraGeometry,
    ) -> Float32Array:
        """Return the light taken away [grey levels, not positive], shape [3, height, width].

        Args:
            indentation_m: Unloaded minus loaded height [m], shape [height, width].
            tilt: Of the loaded gel, shape [2, height, width].
            geometry: Pixels.
        """
        bulge = np.asarray(indentation_m, dtype=np.float32)
        taken = np.zeros((3, *bulge.shape), dtype=np.float32)
        for lamp in self.lamps:
            hidden = self._hidden(bulge, lamp, geometry)
            facing = (
                math.cos(lamp.elevation_rad)
                * (math.cos(lamp.azimuth_rad) * tilt[0] + math.sin(lamp.azimuth_rad) * tilt[1])
            ) + math.sin(lamp.elevation_rad) * np.sqrt(1.0 - tilt[0] ** 2 - tilt[1] ** 2)
            lost = hidden * np.maximum(facing, 0.0)
            for channel, level in enumerate(lamp.colour):
                taken[channel] -= np.float32(level) * lost
        return taken

    def _hidden(self, bulge: Float32Array, lamp: Lamp, geometry: CameraGeometry) -> Float32Array:
        """Return how much of the lamp is hidden, 0 to 1, shape [height, width]."""
        rise = math.tan(lamp.elevation_rad) * geometry.mean_scale_m
        highest = float(bulge.max())
        reach = min(math.ceil(highest / max(rise, 1e-12)), max(bulge.shape))
        step = max(1, math.ceil(reach / _STEPS_AT_MOST))
        above = np.zeros_like(bulge)
        size = bulge.shape[::-1]
        for distance in range(step, reach + 1, step):
            shift = np.array(
                [
                    [1.0, 0.0, distance * math.cos(lamp.azimuth_rad)],
                    [0.0, 1.0, distance * math.sin(lamp.azimuth_rad)],
                ],
                dtype=np.float32,
            )
            towards = cv2.warpAffine(
                bulge, shift, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            )
            np.maximum(above, towards - bulge - np.float32(distance * rise), out=above)
        return np.asarray(np.clip(above / np.float32(self.softness_m), 0.0, 1.0), dtype=np.float32)
