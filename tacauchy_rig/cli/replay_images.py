"""Images of replayed presses without a recording: nominal optics over an evenly grey frame."""

from __future__ import annotations

import numpy as np

from sim.optics.geometry import ImageArray
from sim.optics.nominal_renderer import GREY_LEVEL
from sim.optics.sensor_camera import camera_geometry
from sim.optics.sensor_lamps import nominal_model, shadows_of
from sim.sensor import Sensor
from sim.surface import SurfaceState
from tacauchy_rig.cli.optics import OpticalCalibration
from tacauchy_rig.cli.rendering import image_of


class ReplayImages:
    """Makes the image that a replay makes of a pressed surface, height maps included."""

    def __init__(self, sensor: Sensor) -> None:
        geometry = camera_geometry(sensor)
        self._sensor = sensor
        self._optics = OpticalCalibration(
            model=nominal_model(sensor), geometry=geometry, shadows=shadows_of(sensor)
        )
        shape = (geometry.height, geometry.width, 3)
        self._unloaded = np.full(shape, GREY_LEVEL, dtype=np.uint8)

    def __call__(self, surface: SurfaceState) -> ImageArray:
        """Return the image of a pressed surface."""
        return image_of(surface, self._sensor, self._optics, unloaded=self._unloaded)[1]
