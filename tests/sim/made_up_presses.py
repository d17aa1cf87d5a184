"""Presses of the five objects that nobody solved, for figures and pages."""

import numpy as np

from sim.optics.height.height_map import HeightMaps
from sim.scene.objects import OBJECTS
from sim.studies.objects.study import ObjectPress
from tests.sim.optics.analytic_surface import APEX_M, camera


def object_presses(sensor: str) -> list[ObjectPress]:
    """Return every object, its dent and image that of a ring."""
    x, y = camera().pad_grid()
    dent = 4e-4 * np.exp(-(((np.hypot(x, y) - 2e-3) / 5e-4) ** 2))
    maps = HeightMaps(loaded=APEX_M - dent, rest=np.full_like(dent, APEX_M), contact=dent > 3.9e-4)
    return [
        ObjectPress(
            name=name,
            sensor=sensor,
            force_n=1.5,
            maps=maps,
            surface=make().surface,
            image=np.full((*x.shape, 3), 118, np.uint8),
            geometry=camera(),
            highest_over_m=0.0,
            processor_s=30.0,
        )
        for name, make in OBJECTS.items()
    ]
