"""Warp kernel that sets every environment's next direction or trial, and notes where it is.

As in ``evaluate``, a block of threads has one environment.
"""

# ruff: noqa: SIM109 - device code has no membership test

from __future__ import annotations

import warp as wp

from sim.batch.kernels.state import (
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
    START_ANEW,
    WAIT,
    Found,
    Limits,
    Progress,
    Vectors,
)


@wp.func
def searches_on(
    act: wp.int32, scaled: wp.float64, first: wp.float64, done: wp.int32, limits: Limits
) -> wp.bool:
    """Return whether conjugate gradients take a new direction; ``scaled`` is r . z."""
    goal = limits.forcing * limits.forcing * first
    return act == START or (scaled > goal and done < limits.search_max)


@wp.func
def note(
    b: wp.int32,
    act: wp.int32,
    scaled: wp.float64,
    goes_on: wp.bool,
    progress: Progress,
):
    """Note what an environment has done; ``goes_on`` where it takes a new direction."""
    status = progress.status[b]
    progress.spent[b] = progress.spent[b] + 1
    if act == START:
        progress.status[b] = SEARCH
        progress.newton[b] = progress.newton[b] + 1
        progress.trying[b] = 0
        progress.searches[b] = 0
        progress.slope[b] = wp.float64(0.0)
        progress.first_scaled[b] = scaled
    elif act == ADVANCE_SEARCH:
        progress.slope[b] = progress.slope[b] + progress.length[b] * progress.scaled[b]
        progress.searches[b] = progress.searches[b] + 1
        if not goes_on:
            progress.status[b] = EVALUATE
    elif act == END_SEARCH:
        if progress.searches[b] == 0:
            progress.slope[b] = progress.scaled[b]
        progress.status[b] = EVALUATE
    elif act == SHORTEN:
        progress.fraction[b] = wp.float64(0.5) * progress.fraction[b]
        progress.halvings[b] = progress.halvings[b] + 1
    elif act == NEXT_FRAME:
        progress.frame[b] = progress.frame[b] + 1
        progress.newton[b] = 0
        progress.trying[b] = 0
        progress.retries[b] = 0
    elif act == START_ANEW:
        progress.newton[b] = 0
        progress.trying[b] = 0
        progress.retries[b] = progress.retries[b] + 1
    elif act == GIVE_UP:
        progress.status[b] = FAILED
    if goes_on:
        progress.scaled[b] = scaled
    if status == SEARCH and progress.status[b] == EVALUATE:
        progress.trying[b] = 1
        progress.fraction[b] = wp.float64(1.0)
        progress.halvings[b] = 0
    progress.changed[b] = 0


@wp.kernel(enable_backward=False)
def turn(
    # Model:
    limits: Limits,
    row_count: wp.int32,
    unit: wp.float32,
    depths: wp.array2d(dtype=wp.float64),
    touch: wp.array(dtype=wp.vec3d),
    segment_end: wp.array(dtype=wp.int32),
    # Data in and out:
    progress: Progress,
    vectors: Vectors,
    # Data out:
    tips: wp.array(dtype=wp.vec3d),
    found: Found,
    busy: wp.array(dtype=wp.int32),
):
    """Set directions or trials; launches over [environment_count, threads of a block].

    ``preconditioned`` times ``unit`` is the preconditioner's inverse times what it was given.
    """
    b, thread = wp.tid()
    act = progress.act[b]
    if act != NOTHING:
        # Read before the sum, behind which a thread writes.
        before = progress.scaled[b]
        first = progress.first_scaled[b]
        done = progress.searches[b] + 1
        frame = progress.frame[b]
        changed = progress.changed[b]
        size = unit * wp.float32(progress.norm[b])
        part = wp.float64(0.0)
        if act == START or act == ADVANCE_SEARCH:
            for row in range(thread, row_count, wp.block_dim()):
                z = size * vectors.preconditioned[b, row]
                part += wp.float64(vectors.residuals[b, row]) * wp.float64(z)
        total = wp.tile_sum(wp.tile(part))
        scaled = total[0]
        goes_on = wp.bool(False)
        if act == START or act == ADVANCE_SEARCH:
            goes_on = searches_on(act, scaled, first, done, limits)
        ratio = wp.float32(0.0)
        if goes_on and act == ADVANCE_SEARCH and changed == 0:
            ratio = wp.float32(scaled / before)
        for row in range(thread, row_count, wp.block_dim()):
            if goes_on:
                d = size * vectors.preconditioned[b, row]
                if ratio != wp.float32(0.0):
                    d += ratio * vectors.directions[b, row]
                vectors.directions[b, row] = d
            elif act == ADVANCE_SEARCH:
                step = wp.float64(vectors.steps[b, row])
                vectors.trials[b, row] = vectors.accepted[b, row] + step
        if thread == 0:
            note(b, act, scaled, goes_on, progress)
            if act == NEXT_FRAME:
                load = wp.max(wp.length(progress.push[b]), limits.floor)
                found.push[frame, b] = progress.push[b]
                found.residual[frame, b] = progress.norm[b] / load
                found.imbalance[frame, b] = progress.vertical[b] / load
                found.gap[frame, b] = progress.gap[b]
                if frame + 1 >= depths.shape[0]:
                    progress.status[b] = WAIT
                else:
                    depth = depths[frame + 1, b]
                    tips[b] = touch[b] - wp.vec3d(wp.float64(0.0), wp.float64(0.0), depth)
            running = progress.status[b] == EVALUATE or progress.status[b] == SEARCH
            if running and progress.frame[b] < segment_end[0]:
                busy[0] = 1


@wp.kernel(enable_backward=False)
def begin(
    progress: Progress, segment_end: wp.array(dtype=wp.int32), busy: wp.array(dtype=wp.int32)
):
    """Begin a segment with another preconditioner; launches over [environment_count]."""
    b = wp.tid()
    progress.changed[b] = 1
    running = progress.status[b] == EVALUATE or progress.status[b] == SEARCH
    if running and progress.frame[b] < segment_end[0]:
        busy[0] = 1
