"""The courses of a batch's environments: whether they fit, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.arrays import FloatArray
from sim.batch.environment import Environment
from sim.batch.pilot import Pilot
from sim.solve.load_steps.first_touch import touch_height
from tacauchy_rig.errors import ConfigError


def refuse_unfit(pilot: Pilot, environments: Sequence[Environment]) -> None:
    """End where environments do not fit together or to their pilot.

    Raises:
        ConfigError: Names the first that does not fit.
    """
    if not environments:
        raise ConfigError("a batch without environments", remedy="give at least one")
    lengths = {len(environment.course) for environment in environments}
    if len(lengths) > 1:
        raise ConfigError(
            "the environments of a batch have unlike numbers of frames: "
            + ", ".join(map(str, sorted(lengths))),
            remedy="give each the same number of depths or loads",
        )
    for number, environment in enumerate(environments):
        if environment.is_displaced == pilot.is_pushed:
            given, wanted = ("depths", "loads")[:: 1 if pilot.is_pushed else -1]
            raise ConfigError(
                f"environment {number} has {given}, and the pilot is made for {wanted}",
                remedy=f"give {wanted}, or make a pilot for {given}",
            )
        symmetry = pilot.model.mesh.symmetry
        turned = not np.array_equal(environment.rotation, np.eye(3))
        if symmetry.copies > 1 and (turned or environment.offset_m != (0.0, 0.0)):
            raise ConfigError(
                f"environment {number} moves or turns the indenter, but symmetry lets only a "
                f"{'quarter' if symmetry.copies == 4 else 'half'} of the pad be modelled",
                remedy="mesh the whole pad: switch the effect symmetry off",
            )


def touch_point(pilot: Pilot, environment: Environment) -> FloatArray:
    """Return where an environment's indenter first touches the pad: its tip [m], shape [3]."""
    x, y = np.add(pilot.centre_m, environment.offset_m)
    if environment.offset_m == (0.0, 0.0) and np.array_equal(environment.rotation, np.eye(3)):
        return np.array([x, y, pilot.touch_m])
    model = pilot.model
    height = touch_height(
        model,
        pilot.indenter,
        model.nodes,
        centre_m=(float(x), float(y)),
        rotation=environment.rotation,
    )
    return np.array([x, y, height])


def stretches(pilot: Pilot, courses: FloatArray) -> list[tuple[int, int]]:
    """Return which of a pilot's stiffnesses serves up to which frame: (stiffness, end frame).

    Args:
        courses: Depths [m] or loads on the modelled part [N], shape [frame_count, count].
    """
    nearest = pilot.nearest(courses.mean(axis=1))
    return [
        (int(which), int(np.flatnonzero(nearest == which)[-1]) + 1) for which in np.unique(nearest)
    ]


def extrapolation(courses: FloatArray) -> FloatArray:
    """Return the shares of the last three frames in the next one's start: Lagrange's polynomials.

    The untouched gel, at zero, counts as a frame before the first.

    Args:
        courses: Shape [frame_count, environment_count].

    Returns:
        Shape [frame_count, environment_count, 3], newest first.
    """
    frames, count = courses.shape
    shares = np.zeros((frames, count, 3))
    shares[:, :, 0] = 1.0
    points = np.concatenate([np.zeros((1, count)), courses])
    for frame in range(frames - 1):
        order = min(frame + 1, 3) if frame else 2
        known, ahead = points[frame - order + 2 : frame + 2][::-1], points[frame + 2]
        for k in range(order):
            others = [j for j in range(order) if j != k]
            factors = [(ahead - known[j]) / (known[k] - known[j]) for j in others]
            shares[frame, :, k] = np.prod(factors, axis=0)
    return shares
