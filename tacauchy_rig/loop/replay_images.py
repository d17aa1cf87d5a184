"""Images of replayed presses without a recording: nominal optics over an evenly grey frame."""

from __future__ import annotations

import numpy as np

from sim.fields.surface import SurfaceState
from sim.optics.camera_geometry import ImageArray
from sim.optics.render.nominal_renderer import GREY_LEVEL
from sim.optics.render.sensor_lamps import nominal_model, shadows_of
from sim.optics.sensor_camera import camera_geometry
from sim.sensor.sensor import Sensor
from tacauchy_rig.loop.optics import OpticalCalibration
from tacauchy_rig.loop.rendering import image_of


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
