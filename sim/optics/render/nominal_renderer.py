"""The image of a sensor's nominal optics over an evenly grey no-contact frame."""

from __future__ import annotations

import numpy as np

from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.height.height_map import HeightMaps
from sim.optics.render.render import TactileRenderer
from sim.optics.render.sensor_lamps import nominal_model, shadows_of
from sim.optics.sensor_camera import camera_geometry
from sim.sensor.sensor import Sensor

GREY_LEVEL = 110


class NominalRenderer:
    """Renders height maps as nobody has calibrated them, shadows included where there are any."""

    def __init__(self, sensor: Sensor) -> None:
        self._model = nominal_model(sensor)
        self._shadows = shadows_of(sensor)
        self._geometry: CameraGeometry = camera_geometry(sensor)

    def __call__(self, maps: HeightMaps) -> ImageArray:
        """Return the image of the loaded gel."""
        shape = (self._geometry.height, self._geometry.width, 3)
        background = np.full(shape, GREY_LEVEL, dtype=np.uint8)
        renderer = TactileRenderer(
            background, maps.rest, self._model, self._geometry, shadows=self._shadows
        )
        return renderer.render(maps.loaded)
