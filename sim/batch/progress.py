"""Where the environments of a batch are, and when their iterations end, as the kernels take it."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

from typing import Any

import warp as wp

from sim.batch.environment import BatchOptions
from sim.device import Device


@wp.struct
class Limits:
    """When an environment's iterations end.

    Attributes:
        residual: Residual norm, and sum of the vertical residuals, over the contact force's.
        floor: Residual norm that is always enough [N].
        forcing: Conjugate gradients end at this share of their first residual.
        searches: Most steps of conjugate gradients for one of Newton.
        newton: Most Newton steps for a frame.
        halvings: Most halvings of a step.
        retries: Most further starts of a frame.
        lead: Frames that an environment may be ahead of the stretch's end.
        growth: Most that a step may multiply the residual norm by.
    """

    residual: wp.float64
    floor: wp.float64
    forcing: wp.float64
    searches: wp.int32
    newton: wp.int32
    halvings: wp.int32
    retries: wp.int32
    lead: wp.int32
    growth: wp.float64


def iteration_limits(options: BatchOptions, *, floor_n: float) -> Any:
    """Return the limits as the kernels take them."""
    limits = Limits()
    limits.residual = options.residual_relative
    limits.floor = floor_n
    limits.forcing = options.forcing
    limits.searches = options.search_max
    limits.newton = options.newton_max
    limits.halvings = options.halving_max
    limits.retries = options.retry_max
    limits.lead = options.lead_max
    limits.growth = options.growth_max
    return limits


@wp.struct
class Progress:
    """Where every environment is; each array has shape [environment_count].

    Attributes:
        phase: What it is doing.
        frame: Frames that are behind it.
        newton: Newton steps of this frame.
        searches: Steps of conjugate gradients of this Newton step.
        halvings: Of this Newton step.
        retries: Further starts of this frame.
        trying: 1 while a step is tried.
        fraction: Of the step that is tried.
        slope: Of the energy along the step [J].
        scaled: r . z of the last direction, and of the first.
        first_scaled: The latter.
        act: What an environment does after an evaluation.
        length: Of the step along the direction, while conjugate gradients advance.
        norm: Of the last forces [N].
        started: Of those at which conjugate gradients began [N].
        vertical: Sum of the last forces along z [N].
        push: Force on the indenter, modelled part [N].
        gap: The smallest [m].
        changed: 1 where the preconditioner has changed: a search's directions then begin anew.
        spent: Evaluations so far.
    """

    phase: wp.array(dtype=wp.int32)
    frame: wp.array(dtype=wp.int32)
    newton: wp.array(dtype=wp.int32)
    searches: wp.array(dtype=wp.int32)
    halvings: wp.array(dtype=wp.int32)
    retries: wp.array(dtype=wp.int32)
    trying: wp.array(dtype=wp.int32)
    fraction: wp.array(dtype=wp.float64)
    slope: wp.array(dtype=wp.float64)
    scaled: wp.array(dtype=wp.float64)
    first_scaled: wp.array(dtype=wp.float64)
    act: wp.array(dtype=wp.int32)
    length: wp.array(dtype=wp.float64)
    norm: wp.array(dtype=wp.float64)
    started: wp.array(dtype=wp.float64)
    vertical: wp.array(dtype=wp.float64)
    push: wp.array(dtype=wp.vec3d)
    gap: wp.array(dtype=wp.float64)
    changed: wp.array(dtype=wp.int32)
    spent: wp.array(dtype=wp.int32)


@wp.func
def may_run(
    b: wp.int32, progress: Progress, limits: Limits, stretch_end: wp.array(dtype=wp.int32)
) -> wp.bool:
    """Return whether the stiffness that preconditions is still near to an environment."""
    return progress.frame[b] < stretch_end[0] + limits.lead


def new_progress(count: int, device: Device) -> Any:
    """Return the arrays for so many environments."""
    progress = Progress()
    names = ("phase", "frame", "newton", "searches", "halvings", "trying", "act")
    for name in (*names, "changed", "spent", "retries"):
        setattr(progress, name, device.zeros(count, wp.int32))
    names = ("length", "fraction", "slope", "scaled", "first_scaled")
    for name in (*names, "norm", "started", "vertical", "gap"):
        setattr(progress, name, device.zeros(count, wp.float64))
    progress.push = device.zeros(count, wp.vec3d)
    return progress
