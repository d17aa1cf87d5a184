"""A sensor's camera as the renderer wants to know it."""

from __future__ import annotations

from sim.optics.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor


def camera_geometry(sensor: Sensor) -> CameraGeometry:
    """Return the renderer's pixels for a sensor."""
    view = sensor.camera
    return CameraGeometry(
        width=view.width,
        height=view.height,
        scale_x_m=view.pixel_m[0],
        scale_y_m=view.pixel_m[1],
        centre_x_px=0.5 * (view.width - 1) - view.centre_m[0] / view.pixel_m[0],
        centre_y_px=0.5 * (view.height - 1) - view.centre_m[1] / view.pixel_m[1],
        crop_fraction=view.crop,
    )
