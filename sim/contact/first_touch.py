"""Where indenters first touch a resting gel, for many of them at once."""

import numpy as np
import warp as wp

from sim.contact.indenter_distance import Body, Poses, body_of, nearby_gap, posed, poses_at
from sim.device import Device
from sim.scene.indenter import IndenterSet, TurnedIndenter
from sim.scene.pad import Pad
from tacauchy_rig.core.arrays import FloatArray

# Points along each side of the grids on which touch is sought, each around the best point of the
# grid before; the most steps down, and the distance that counts as touch [m].
_GRIDS = (61, 41, 41)
_STEPS, _TOUCHES_M = 30, 1e-9


@wp.kernel(enable_backward=False, module="unique")
def _gaps(
    bodies: wp.array(dtype=Body),
    poses: Poses,
    # Data in:
    points: wp.array2d(dtype=wp.vec3d),
    lowered: wp.array(dtype=wp.float64),
    # Data in and out:
    gap_io: wp.array2d(dtype=wp.float64),
):
    """Find how far points are at least from indenters that were moved by what was left [m]."""
    b, p = wp.tid()
    by = wp.abs(lowered[b])
    least = gap_io[b, p] - by
    if least <= by:
        least, _n = nearby_gap(posed(bodies, poses, b), points[b, p], by)
    gap_io[b, p] = least


def first_touch(
    pad: Pad,
    indenters: IndenterSet,
    places: FloatArray,
    rotations: FloatArray,
    *,
    device: str = "cpu",
) -> FloatArray:
    """Return the heights of tips at which indenters first touch the resting gel [m], shape [count].

    A body goes down by its distance from the gel until none is left: it meets nothing on that way.

    Args:
        places: Tips in the plan [m], shape [count, 2].
        rotations: Indenter frame to pad frame, shape [count, 3, 3].
    """
    on, body = Device(device), body_of(indenters, device=device)
    half = np.array(pad.half_extents())
    pairs = zip(indenters.which, rotations, strict=True)
    turned = [TurnedIndenter(indenter=indenters.bodies[k], rotation=turn) for k, turn in pairs]
    reach = np.clip(np.array([each.reach() for each in turned]), -2.0 * half, 2.0 * half)
    low, high = np.clip(places[:, None] + reach, -half, half).transpose(1, 0, 2)
    heights = pad.height_m + np.linalg.norm(reach, axis=2).max(axis=1)
    for count in _GRIDS:
        steps = np.linspace(0.0, 1.0, count)
        x, y = (low[:, [k]] + np.outer(high[:, k] - low[:, k], steps) for k in (0, 1))
        x, y = np.repeat(x, count, axis=1), np.tile(y, count)
        points = on.array(np.stack([x, y, pad.height_at(x, y)], axis=-1), wp.vec3d)
        gaps, lowered = on.zeros(x.shape, wp.float64), np.zeros(len(places))
        for _ in range(_STEPS):
            poses = poses_at(np.column_stack([places, heights]), rotations, on)
            inputs = [body, poses, points, on.array(lowered, wp.float64)]
            on.launch(_gaps, x.shape, inputs, [gaps])
            found = gaps.numpy()
            heights = heights - (lowered := found.min(axis=1))
            if np.abs(lowered).max() < _TOUCHES_M:
                break
        best, step = found.argmin(axis=1)[:, None, None], 2.0 * (high - low) / (count - 1)
        at = np.take_along_axis(np.stack([x, y], axis=-1), best, axis=1)[:, 0]
        low, high = np.clip(at - step, -half, half), np.clip(at + step, -half, half)
    return np.asarray(heights)
