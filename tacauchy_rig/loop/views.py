"""A sensor's camera as the report wants to know it."""

from __future__ import annotations

from reports.evidence.evidence import ImageGeometry
from sim.sensor.sensor import Sensor


def scored_geometry(sensor: Sensor) -> ImageGeometry:
    """Return how frames of a sensor become the images that are scored."""
    view = sensor.camera
    return ImageGeometry(
        crop_fraction=view.crop,
        width_px=view.width,
        height_px=view.height,
        scale_x_m_px=view.pixel_m[0],
        scale_y_m_px=view.pixel_m[1],
    )
