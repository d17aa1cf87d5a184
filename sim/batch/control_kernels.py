"""Warp kernels that steer a batch: each environment's Newton and conjugate gradients on its own.

One tick gives every environment one evaluation, of forces or of the stiffness along a direction,
and one application of the preconditioner. ``sum_up`` gathers what an environment must know of its
vectors, ``decide`` says what to do, ``change_vectors`` does it, ``commit`` notes it, and ``turn``
sets the next direction or trial.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors
# ruff: noqa: SIM109 - device code has no membership test

from __future__ import annotations

import warp as wp

from sim.batch.phases import (
    ADVANCE_SEARCH,
    END_SEARCH,
    EVALUATE,
    FAILED,
    GIVE_UP,
    NEXT_FRAME,
    NOTHING,
    SEARCH,
    SHORTEN,
    START,
    WAIT,
)
from sim.batch.progress import Limits, Progress

# Rows of the sums over an environment's unknowns.
RESIDUAL = wp.constant(0)  # y . y
SLOPE = wp.constant(1)  # y . d
CURVATURE = wp.constant(2)  # p . y
PRECONDITIONED = wp.constant(3)  # r . z
VERTICAL = wp.constant(4)  # sum of y along z
SUM_COUNT = 5

# What ``turn`` does.
KEEP = wp.constant(0)
NEW_DIRECTION = wp.constant(1)
TRY_STEP = wp.constant(2)


@wp.kernel(enable_backward=False)
def decide(
    # Model:
    limits: Limits,
    # Data in:
    sums: wp.array2d(dtype=wp.float64),
    push: wp.array(dtype=wp.vec3d),
    # Data in and out:
    progress: Progress,
):
    """Say what every environment does after its evaluation; launches over [environment_count]."""
    b = wp.tid()
    phase = progress.phase[b]
    act = wp.int32(NOTHING)
    if phase == SEARCH:
        act = wp.int32(END_SEARCH)
        if sums[CURVATURE, b] > wp.float64(0.0):
            act = wp.int32(ADVANCE_SEARCH)
            progress.length[b] = progress.scaled[b] / sums[CURVATURE, b]
    if phase == EVALUATE:
        residual = wp.sqrt(sums[RESIDUAL, b])
        finite = wp.isfinite(residual)
        uphill = progress.trying[b] == 1 and not (
            sums[SLOPE, b] <= wp.float64(0.9) * progress.slope[b]
        )
        enough = wp.max(limits.floor, limits.residual * wp.length(push[b]))
        act = wp.int32(START)
        if (uphill or not finite) and progress.halvings[b] < limits.halvings:
            act = wp.int32(SHORTEN)
        elif residual <= enough and wp.abs(sums[VERTICAL, b]) <= enough:
            act = wp.int32(NEXT_FRAME)
        elif progress.newton[b] >= limits.newton or not finite:
            act = wp.int32(GIVE_UP)
    progress.act[b] = act


@wp.kernel(enable_backward=False)
def sum_up(
    # Model:
    row_count: wp.int32,
    part_count: wp.int32,
    vertical: wp.array(dtype=wp.int32),
    progress: Progress,
    # Data in:
    forces: wp.array2d(dtype=wp.float64),
    steps: wp.array2d(dtype=wp.float32),
    directions: wp.array2d(dtype=wp.float32),
    # Data out:
    sums_out: wp.array2d(dtype=wp.float64),
    busy_out: wp.array(dtype=wp.int32),
):
    """Sum what decisions need; launches over [part_count, environment_count]."""
    part, b = wp.tid()
    if part == 0 and b == 0:
        busy_out[0] = 0
    phase = progress.phase[b]
    if phase == EVALUATE or phase == SEARCH:
        a = wp.float64(0.0)
        c = wp.float64(0.0)
        v = wp.float64(0.0)
        for row in range(part, row_count, part_count):
            y = forces[row, b]
            if phase == SEARCH:
                c += y * wp.float64(directions[row, b])
            else:
                a += y * y
                c += y * wp.float64(steps[row, b])
                if vertical[row] == 1:
                    v += y
        if phase == SEARCH:
            wp.atomic_add(sums_out, CURVATURE, b, c)
        else:
            wp.atomic_add(sums_out, RESIDUAL, b, a)
            wp.atomic_add(sums_out, SLOPE, b, c)
            wp.atomic_add(sums_out, VERTICAL, b, v)


@wp.kernel(enable_backward=False)
def change_vectors(
    # Model:
    progress: Progress,
    shares: wp.array3d(dtype=wp.float64),
    tip_row: wp.int32,
    # Data in:
    directions: wp.array2d(dtype=wp.float32),
    # Data out:
    forces: wp.array2d(dtype=wp.float64),
    trials: wp.array2d(dtype=wp.float64),
    accepted: wp.array2d(dtype=wp.float64),
    before: wp.array2d(dtype=wp.float64),
    long_before: wp.array2d(dtype=wp.float64),
    steps: wp.array2d(dtype=wp.float32),
    residuals: wp.array2d(dtype=wp.float32),
    lift_out: wp.array2d(dtype=wp.float64),
):
    """Do what is decided; launches over [row_count, environment_count]."""
    row, b = wp.tid()
    act = progress.act[b]
    y = wp.float64(0.0)
    if act != NOTHING:
        y = forces[row, b]
        forces[row, b] = wp.float64(0.0)
    if act == START:
        residuals[row, b] = wp.float32(-y)
        steps[row, b] = wp.float32(0.0)
        accepted[row, b] = trials[row, b]
    elif act == ADVANCE_SEARCH:
        alpha = progress.length[b]
        steps[row, b] = steps[row, b] + wp.float32(alpha) * directions[row, b]
        residuals[row, b] = residuals[row, b] - wp.float32(alpha * y)
    elif act == END_SEARCH:
        d = steps[row, b]
        if progress.searches[b] == 0:
            d = directions[row, b]
            steps[row, b] = d
        trials[row, b] = accepted[row, b] + wp.float64(d)
    elif act == SHORTEN:
        fraction = wp.float64(0.5) * progress.fraction[b]
        trials[row, b] = accepted[row, b] + fraction * wp.float64(steps[row, b])
    elif act == NEXT_FRAME:
        frame = progress.frame[b]
        now = trials[row, b]
        last = before[row, b]
        older = long_before[row, b]
        ahead = shares[frame, b, 0] * now + shares[frame, b, 1] * last
        trials[row, b] = ahead + shares[frame, b, 2] * older
        long_before[row, b] = last
        before[row, b] = now
        if row == tip_row:
            lift_out[frame, b] = now


@wp.kernel(enable_backward=False)
def commit(
    # Model:
    limits: Limits,
    depths: wp.array2d(dtype=wp.float64),
    touch: wp.array(dtype=wp.vec3d),
    stretch_end: wp.array(dtype=wp.int32),
    # Data in and out:
    progress: Progress,
    sums: wp.array2d(dtype=wp.float64),
    push: wp.array(dtype=wp.vec3d),
    gaps: wp.array(dtype=wp.float64),
    # Data out:
    tips: wp.array(dtype=wp.vec3d),
    busy: wp.array(dtype=wp.int32),
    push_out: wp.array2d(dtype=wp.vec3d),
    residual_out: wp.array2d(dtype=wp.float64),
    imbalance_out: wp.array2d(dtype=wp.float64),
    gap_out: wp.array2d(dtype=wp.float64),
):
    """Note what was decided; launches over [environment_count]."""
    b = wp.tid()
    act = progress.act[b]
    scaled = sums[PRECONDITIONED, b]
    phase = progress.phase[b]
    progress.turn[b] = KEEP
    if phase == EVALUATE or phase == SEARCH:
        progress.spent[b] = progress.spent[b] + 1
    if act == START:
        progress.phase[b] = SEARCH
        progress.newton[b] = progress.newton[b] + 1
        progress.trying[b] = 0
        progress.searches[b] = 0
        progress.slope[b] = wp.float64(0.0)
        progress.scaled[b] = scaled
        progress.first_scaled[b] = scaled
        progress.ratio[b] = wp.float64(0.0)
        progress.turn[b] = NEW_DIRECTION
    elif act == ADVANCE_SEARCH:
        progress.slope[b] = progress.slope[b] + progress.length[b] * progress.scaled[b]
        done = progress.searches[b] + 1
        progress.searches[b] = done
        goal = limits.forcing * limits.forcing * progress.first_scaled[b]
        if scaled > goal and done < limits.searches:
            progress.ratio[b] = scaled / progress.scaled[b]
            if progress.changed[b] == 1:
                progress.ratio[b] = wp.float64(0.0)
            progress.scaled[b] = scaled
            progress.turn[b] = NEW_DIRECTION
        else:
            progress.phase[b] = EVALUATE
            progress.turn[b] = TRY_STEP
    elif act == END_SEARCH:
        if progress.searches[b] == 0:
            progress.slope[b] = progress.scaled[b]
        progress.phase[b] = EVALUATE
    elif act == SHORTEN:
        progress.fraction[b] = wp.float64(0.5) * progress.fraction[b]
        progress.halvings[b] = progress.halvings[b] + 1
    elif act == NEXT_FRAME:
        frame = progress.frame[b]
        load = wp.length(push[b])
        push_out[frame, b] = push[b]
        residual_out[frame, b] = wp.sqrt(sums[RESIDUAL, b]) / wp.max(load, limits.floor)
        imbalance_out[frame, b] = sums[VERTICAL, b] / wp.max(load, limits.floor)
        gap_out[frame, b] = gaps[b]
        progress.frame[b] = frame + 1
        progress.newton[b] = 0
        progress.trying[b] = 0
        if frame + 1 >= depths.shape[0]:
            progress.phase[b] = WAIT
        else:
            tips[b] = touch[b] - wp.vec3d(wp.float64(0.0), wp.float64(0.0), depths[frame + 1, b])
    elif act == GIVE_UP:
        progress.phase[b] = FAILED
    if phase == SEARCH and progress.phase[b] == EVALUATE:
        progress.trying[b] = 1
        progress.fraction[b] = wp.float64(1.0)
        progress.halvings[b] = 0
    progress.changed[b] = 0
    for k in range(sums.shape[0]):
        sums[k, b] = wp.float64(0.0)
    push[b] = wp.vec3d()
    gaps[b] = wp.float64(1.0)
    running = progress.phase[b] == EVALUATE or progress.phase[b] == SEARCH
    if running and progress.frame[b] < stretch_end[0]:
        busy[0] = 1


@wp.kernel(enable_backward=False)
def turn(
    # Model:
    progress: Progress,
    # Data in:
    preconditioned: wp.array2d(dtype=wp.float32),
    accepted: wp.array2d(dtype=wp.float64),
    steps: wp.array2d(dtype=wp.float32),
    # Data out:
    directions: wp.array2d(dtype=wp.float32),
    trials: wp.array2d(dtype=wp.float64),
):
    """Set the next direction or trial; launches over [row_count, environment_count]."""
    row, b = wp.tid()
    act = progress.turn[b]
    if act == NEW_DIRECTION:
        ratio = wp.float32(progress.ratio[b])
        old = wp.float32(0.0)
        if ratio != wp.float32(0.0):
            old = ratio * directions[row, b]
        directions[row, b] = preconditioned[row, b] + old
    elif act == TRY_STEP:
        trials[row, b] = accepted[row, b] + wp.float64(steps[row, b])


@wp.kernel(enable_backward=False)
def begin(
    progress: Progress, stretch_end: wp.array(dtype=wp.int32), busy: wp.array(dtype=wp.int32)
):
    """Begin a stretch with another preconditioner; launches over [environment_count]."""
    b = wp.tid()
    progress.changed[b] = 1
    running = progress.phase[b] == EVALUATE or progress.phase[b] == SEARCH
    if running and progress.frame[b] < stretch_end[0]:
        busy[0] = 1
