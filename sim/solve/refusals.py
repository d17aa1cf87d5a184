"""What a press is refused for: an indenter that has passed through, or is at the gel's base.

A gap is measured to the nearest side of the indenter. Where gel has come past the middle of a small
body, the nearest side is the wrong one: contact then pulls the gel's surface, or has none.
"""

from __future__ import annotations

import numpy as np

from sim.scene.indenter import Indenter, Plane, TurnedIndenter
from tacauchy_rig.core.arrays import FloatArray

# What presses has 0.9 to 1.0, under the folds of a deep sharp rim too; what has passed through, a
# part of it or all, 0.03 to -1.0.
_FACING_LEAST = 0.6
_SAMPLES = 65


def faces_gel(forces: FloatArray, outward: FloatArray, *, friction: float) -> bool:
    """Return whether a contact presses on the outside of the gel, wherever it touches.

    Args:
        forces: On the indenter [N], shape [face_count, point_count, 3].
        outward: Normals of the gel's surface at these points, of any length, likewise.
        friction: Coefficient by which forces may lean [-].
    """
    sizes = np.linalg.norm(outward, axis=2)
    pushed = np.einsum("fpi,fpi->fp", forces, outward) / np.maximum(sizes, 1e-300)
    least = _FACING_LEAST / np.hypot(1.0, friction)
    return bool(pushed.sum() >= least * np.linalg.norm(forces, axis=2).sum())


def base_depth_m(
    indenter: Indenter, rotation: FloatArray, *, reach_m: FloatArray, touch_m: float
) -> float:
    """Return the depth at which an indenter's lowest point over the pad is at the gel's base [m].

    Args:
        reach_m: Least and greatest x and y of the pad seen from the tip [m], shape [2, 2].
        touch_m: Height of the tip at first touch [m].
    """
    if isinstance(indenter, Plane) or np.array_equal(rotation, np.eye(3)):
        return touch_m
    turned = TurnedIndenter(indenter=indenter, rotation=rotation)
    low, high = (np.clip(each, *reach_m) for each in turned.reach())
    axes = [np.linspace(a, b, _SAMPLES) for a, b in zip(low, high, strict=True)]
    heights = turned.lower_surface(*np.meshgrid(*axes, indexing="ij"))
    return touch_m + min(0.0, float(heights.min()))
