"""Warp kernel that evaluates the forces of environments that want it, and does what they call for.

A block of threads has one environment, so that what it decides is known to all that act on it, and
elements hand their forces over in shared memory. On the CPU a block is one thread.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from sim.batch.kernels.contact_forces import (
    BatchSurface,
    ContactPoints,
    contact_force,
    spread_contact,
)
from sim.batch.kernels.element_forces import (
    BatchGel,
    Tangents,
    forces_function,
    hand_over_function,
    room_for,
)
from sim.batch.kernels.gathering import Gathering, Layout, gathered, gathered_contact, wait_for_all
from sim.batch.kernels.state import (
    EVALUATE,
    GIVE_UP,
    NEXT_FRAME,
    NOTHING,
    SEARCH,
    SHORTEN,
    START,
    START_ANEW,
    Limits,
    Progress,
    Vectors,
    may_run,
)
from sim.material.laws.tangent import Law
from sim.mesh.elements import ElementOrder, reference_element

# Sums over an environment's unknowns.
RESIDUAL = wp.constant(0)  # y . y
SLOPE = wp.constant(1)  # y . d
VERTICAL = wp.constant(2)  # sum of y along z


@wp.func
def judged(
    b: wp.int32, sums: wp.vec3d, pushed: wp.vec3d, limits: Limits, progress: Progress
) -> wp.int32:
    """Return what forces call for."""
    act = wp.int32(START)
    residual = wp.sqrt(sums[RESIDUAL])
    finite = wp.isfinite(residual)
    uphill = not (sums[SLOPE] <= wp.float64(0.9) * progress.slope[b])
    # Along a direction that is almost without stiffness a step may leave the gel in tatters and yet
    # end on a slope downwards.
    far = residual > limits.growth_max * progress.started[b]
    too_long = progress.trying[b] == 1 and (uphill or far)
    enough = wp.max(limits.floor, limits.residual_relative * wp.length(pushed))
    if (too_long or not finite) and progress.halvings[b] < limits.halving_max:
        act = wp.int32(SHORTEN)
    elif residual <= enough and wp.abs(sums[VERTICAL]) <= enough:
        act = wp.int32(NEXT_FRAME)
    elif progress.newton[b] >= limits.newton_max or not finite:
        act = wp.int32(GIVE_UP)
        if progress.retries[b] < limits.retry_max:
            act = wp.int32(START_ANEW)
    return act


@wp.func
def change(
    row: wp.int32,
    b: wp.int32,
    act: wp.int32,
    frame: wp.int32,
    shares: wp.array3d(dtype=wp.float64),
    progress: Progress,
    vectors: Vectors,
):
    """Do to the vectors what is called for."""
    now = vectors.trials[b, row]
    if act == START:
        vectors.residuals[b, row] = wp.float32(-vectors.forces[b, row])
        vectors.steps[b, row] = wp.float32(0.0)
        vectors.accepted[b, row] = now
    elif act == SHORTEN:
        fraction = wp.float64(0.5) * progress.fraction[b]
        step = fraction * wp.float64(vectors.steps[b, row])
        vectors.trials[b, row] = vectors.accepted[b, row] + step
    elif act == START_ANEW:
        last_step = vectors.before[b, row] - vectors.long_before[b, row]
        ahead_by = wp.float64(0.5) * wp.float64(progress.retries[b])
        vectors.trials[b, row] = vectors.before[b, row] + ahead_by * last_step
    elif act == NEXT_FRAME:
        last = vectors.before[b, row]
        older = vectors.long_before[b, row]
        ahead = shares[frame, b, 0] * now + shares[frame, b, 1] * last
        vectors.trials[b, row] = ahead + shares[frame, b, 2] * older
        vectors.long_before[b, row] = last
        vectors.before[b, row] = now


@wp.func
def tip_of(
    b: wp.int32, tips: wp.array(dtype=wp.vec3d), gathering: Gathering, vectors: Vectors
) -> wp.vec3d:
    """Return where an environment's indenter ends [m]."""
    tip = tips[b]
    if gathering.tip_row >= 0:
        lift = vectors.trials[b, gathering.tip_row]
        tip += wp.vec3d(wp.float64(0.0), wp.float64(0.0), lift)
    return tip


@wp.func
def touch(
    b: wp.int32,
    thread: wp.int32,
    tip: wp.vec3d,
    surface: BatchSurface,
    displacements: Any,
    contact: ContactPoints,
) -> wp.vec4d:
    """Find contact at a thread's points; return the force on the indenter and the smallest gap."""
    push = wp.vec3d()
    nearest = wp.float64(1.0)
    for i in range(thread, surface.areas.shape[0] * surface.areas.shape[1], wp.block_dim()):
        v, stiffness, gap = contact_force(i, b, tip, surface, displacements)
        contact.forces[b, i] = v
        contact.touching[b, i] = wp.where(gap < surface.distance, 1, 0)
        if gap < surface.distance:
            contact.stiffness[b, i] = stiffness
            nearest = wp.min(nearest, gap)
        push += v
    return wp.vec4d(push[0], push[1], push[2], nearest)


@wp.func
def summands(
    row: wp.int32, b: wp.int32, y: wp.float64, gathering: Gathering, vectors: Vectors
) -> wp.vec3d:
    """Return what an unknown adds to the sums."""
    vertical = wp.float64(0.0)
    if gathering.vertical[row] == 1:
        vertical = y
    return wp.vec3d(y * y, y * wp.float64(vectors.steps[b, row]), vertical)


@wp.func
def act_on(
    b: wp.int32,
    thread: wp.int32,
    act: wp.int32,
    norm: wp.float64,
    gathering: Gathering,
    shares: wp.array3d(dtype=wp.float64),
    progress: Progress,
    vectors: Vectors,
    sources_out: wp.array2d(dtype=Any),
    lift_out: wp.array2d(dtype=wp.float64),
):
    """Do to a thread's unknowns what is called for, and say what the preconditioner is asked."""
    frame = progress.frame[b]
    for row in range(thread, gathering.row_count, wp.block_dim()):
        change(row, b, act, frame, shares, progress, vectors)
        # The preconditioner is asked for nothing unless a search starts.
        source = wp.float32(0.0)
        if act == START:
            source = vectors.residuals[b, row] / wp.float32(norm)
        sources_out[b, row] = sources_out.dtype(source)
        if act == NEXT_FRAME and row == gathering.tip_row:
            lift_out[frame, b] = vectors.before[b, row]


@wp.func
def keep(
    b: wp.int32,
    act: wp.int32,
    sums: wp.vec3d,
    pushed: wp.vec3d,
    gap: wp.float64,
    progress: Progress,
):
    """Keep what was found of an environment."""
    norm = wp.sqrt(sums[RESIDUAL])
    progress.act[b] = act
    progress.norm[b] = norm
    if act == START:
        progress.started[b] = norm
    progress.vertical[b] = sums[VERTICAL]
    progress.push[b] = pushed
    progress.gap[b] = gap


@cache
def evaluate_kernel(law: Law, order: ElementOrder, layout: Layout) -> Any:
    """Build the kernel; it launches over [environment_count, threads of a block]."""
    reference = reference_element(order)
    hand_over = hand_over_function(forces_function(law, reference), reference, layout)
    width, room = layout.width, room_for(reference, layout)
    bounds = (layout.threads, layout.resident)

    @wp.kernel(enable_backward=False, module="unique", launch_bounds=bounds)
    def evaluate(
        # Model:
        limits: Limits,
        gel: BatchGel,
        surface: BatchSurface,
        gathering: Gathering,
        shares: wp.array3d(dtype=wp.float64),
        loads: wp.array2d(dtype=wp.float64),
        # Data in:
        tips: wp.array(dtype=wp.vec3d),
        segment_end: wp.array(dtype=wp.int32),
        # Data in and out:
        progress: Progress,
        vectors: Vectors,
        # Data out:
        contact: ContactPoints,
        tangents: Tangents,
        sources_out: wp.array2d(dtype=Any),
        lift_out: wp.array2d(dtype=wp.float64),
        busy_out: wp.array(dtype=wp.int32),
    ):
        b, thread = wp.tid()
        if b == 0 and thread == 0:
            busy_out[0] = 0
        status = progress.status[b]
        runs = may_run(b, progress, limits, segment_end)
        if status == EVALUATE and runs:
            frame = progress.frame[b]
            at = wp.tile_load(vectors.trials[b], shape=wp.static(width), storage="shared")
            tip = tip_of(b, tips, gathering, vectors)
            felt = touch(b, thread, tip, surface, at, contact)
            all_push = wp.tile_sum(wp.tile(wp.vec3d(felt[0], felt[1], felt[2]), preserve_type=True))
            pushed = all_push[0]
            all_gaps = wp.tile_min(wp.tile(felt[3]))
            for i in range(thread, surface.rest.shape[0] * surface.rest.shape[1], wp.block_dim()):
                spread_contact(i, b, surface, contact)

            part = wp.vec3d()
            contributions = wp.tile_zeros(shape=wp.static(room), dtype=wp.float64, storage="shared")
            for c in range(gathering.starts.shape[0]):
                hand_over(c, b, thread, gel, at, tangents, gathering, contributions)
                for row in range(thread, gathering.row_count, wp.block_dim()):
                    y = gathered(row, c, gathering, contributions)
                    if c == 0:
                        y += gathered_contact(row, b, gathering, contact.face_forces)
                    else:
                        y += vectors.forces[b, row]
                    if row == gathering.tip_row:
                        y = loads[frame, b] - pushed[2]
                    vectors.forces[b, row] = y
                    if c == gathering.starts.shape[0] - 1:
                        part += summands(row, b, y, gathering, vectors)
                wait_for_all(contributions)
            all_sums = wp.tile_sum(wp.tile(part, preserve_type=True))
            sums = all_sums[0]
            act = judged(b, sums, pushed, limits, progress)
            norm = wp.sqrt(sums[RESIDUAL])
            act_on(
                b, thread, act, norm, gathering, shares, progress, vectors, sources_out, lift_out
            )
            if thread == 0:
                keep(b, act, sums, pushed, all_gaps[0], progress)
        elif thread == 0 and not (status == SEARCH and runs):
            progress.act[b] = NOTHING

    return evaluate
