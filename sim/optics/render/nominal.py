"""Images of a sensor that nobody has calibrated."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from sim.optics.colour.nominal import nominal_model
from sim.optics.height.height_map import HeightMaps
from sim.optics.render.renderer import GREY_LEVEL, TactileRenderer
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import ImageArray


def nominal_renderer(
    sensor: Sensor, *, level: int = GREY_LEVEL, samples: int = 1
) -> Callable[[HeightMaps], ImageArray]:
    """Return what renders the loaded gel uncalibrated over an evenly grey no-contact frame."""
    model, geometry = nominal_model(sensor), sensor.camera
    even = np.full((geometry.height, geometry.width, 3), level, dtype=np.uint8)
    ready = partial(TactileRenderer, shadows=sensor.optics.shadows, samples=samples)
    return lambda maps: ready(even, maps.rest, model, geometry).render(maps.loaded)
