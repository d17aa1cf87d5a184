"""A press without mechanics: the indenter's own shape, cut into the gel.

So simple simulators draw: nothing bends beside the indenter, and nothing gives below it.
"""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.scene.indenter import Indenter
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry


def rigid_heights(
    pad: Pad,
    indenter: Indenter,
    geometry: CameraGeometry,
    *,
    depth_m: float,
    place_m: tuple[float, float] = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Return z of the surface at rest and cut by an upright indenter [m], each [height, width].

    Args:
        depth_m: Of the tip below the pad's top at its place [m].
        place_m: Where the tip comes down, in the pad's frame [m].
    """
    x, y = geometry.pad_grid()
    rest = np.asarray(pad.height_at(x, y), dtype=np.float64)
    top = float(pad.height_at(np.array([place_m[0]]), np.array([place_m[1]]))[0])
    underside = top - depth_m + indenter.lower_surface(x - place_m[0], y - place_m[1])
    return rest, np.asarray(np.minimum(rest, underside))
