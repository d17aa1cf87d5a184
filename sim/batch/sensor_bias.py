"""The bias of forces on a sensor's mesh, and what may remain of it.

Such a mesh is too stiff where its edges are as long as the contact is wide, and contact that gives
way (``sensor_batch``) takes a little too much where it is wide for the pad's height. Together

    F / F_fine = 1 + share h / H + slope (h / a)^1.5

with the edge length h at the surface, the pad's height H and the radius a of a disc of the
contact's area. The numbers were fitted to 240 forces of drawn balls and rounded punches on two
sensors and meshes of three edges, against presses on fine meshes of their own; so was what
remains, for 19 forces of 20. Sharp bodies were compared with four presses only, friction not at
all.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.arrays import FloatArray


class Rim(IntEnum):
    """How a body's edge compares with a mesh's."""

    ROUND = 0
    """Its radius is more than a quarter of an edge's length."""
    NARROW = 1
    """It is less."""
    SHARP = 2
    """It has none, or none that is known."""


# Share of the bias by ``Rim``, and its slope; then both of what remains.
_SHARES, _SLOPE = np.array([-0.104, 0.121, 0.0]), 0.053
_SHARES_LEFT, _SLOPE_LEFT = np.array([0.10, 0.25, 0.30]), 0.03


def force_bias(
    area_m2: FloatArray, *, edge_m: float, height_m: float, rims: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return the bias of forces, and what may remain of it; relative to them, shape [count].

    Args:
        area_m2: Of what touches, at rest, shape [count].
        edge_m: Edge length at the surface of the mesh.
        height_m: Of the pad.
        rims: Of the bodies, by ``Rim``, shape [count].
    """
    radius_m = np.sqrt(np.maximum(area_m2, 1e-300) / np.pi)
    narrow = np.where(area_m2 > 0.0, (edge_m / radius_m) ** 1.5, 0.0)
    wide = edge_m / height_m
    bias = _SHARES[rims] * wide + _SLOPE * narrow
    return bias, _SHARES_LEFT[rims] * wide + _SLOPE_LEFT * narrow
