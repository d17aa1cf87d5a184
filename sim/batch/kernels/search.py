"""Warp kernel of a step of conjugate gradients, for the environments that search.

As in ``evaluate``, a block of threads has one environment.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from sim.batch.kernels.contact_forces import (
    BatchSurface,
    ContactPoints,
    contact_rate,
    spread_contact,
)
from sim.batch.kernels.element_forces import (
    BatchGel,
    Tangents,
    hand_over_function,
    rates_function,
    room_for,
)
from sim.batch.kernels.gathering import Gathering, Layout, gathered, gathered_contact, wait_for_all
from sim.batch.kernels.state import (
    ADVANCE_SEARCH,
    END_SEARCH,
    SEARCH,
    Limits,
    Progress,
    Vectors,
    may_run,
)
from sim.mesh.elements import ElementOrder, reference_element


@wp.func
def step_on(
    row: wp.int32,
    b: wp.int32,
    length: wp.float64,
    norm: wp.float32,
    vectors: Vectors,
    sources_out: wp.array2d(dtype=Any),
):
    """Go along the direction, and ask the preconditioner for the next."""
    step = wp.float32(length) * vectors.directions[b, row]
    vectors.steps[b, row] = vectors.steps[b, row] + step
    left = vectors.residuals[b, row] - wp.float32(length) * vectors.rates[b, row]
    vectors.residuals[b, row] = left
    sources_out[b, row] = sources_out.dtype(left / norm)


@wp.func
def take_what_there_is(row: wp.int32, b: wp.int32, is_first: wp.bool, vectors: Vectors):
    """Try the steps so far, or a first direction as it is: it has no positive curvature."""
    d = vectors.steps[b, row]
    if is_first:
        d = vectors.directions[b, row]
        vectors.steps[b, row] = d
    vectors.trials[b, row] = vectors.accepted[b, row] + wp.float64(d)


@wp.func
def touch_rates(
    b: wp.int32,
    thread: wp.int32,
    sink: wp.float32,
    surface: BatchSurface,
    along: Any,
    contact: ContactPoints,
) -> wp.float64:
    """Find how a thread's contact forces change; return the change of the force that pushes."""
    pushing = wp.float64(0.0)
    for i in range(thread, surface.areas.shape[0] * surface.areas.shape[1], wp.block_dim()):
        # Where nothing touches, ``evaluate`` has left a zero.
        if contact.touching[b, i] == 1:
            v = contact_rate(i, sink, contact.stiffness[b, i], surface, along)
            contact.forces[b, i] = v
            pushing += v[2]
    return pushing


@cache
def search_kernel(order: ElementOrder, layout: Layout) -> Any:
    """Build the kernel; it launches over [environment_count, threads of a block]."""
    reference = reference_element(order)
    hand_over = hand_over_function(rates_function(reference), reference, layout)
    width, room = layout.width, room_for(reference, layout)
    bounds = (layout.threads, layout.resident)

    @wp.kernel(enable_backward=False, module="unique", launch_bounds=bounds)
    def search(
        # Model:
        limits: Limits,
        gel: BatchGel,
        surface: BatchSurface,
        gathering: Gathering,
        # Data in:
        tangents: Tangents,
        segment_end: wp.array(dtype=wp.int32),
        # Data in and out:
        progress: Progress,
        vectors: Vectors,
        contact: ContactPoints,
        # Data out:
        sources_out: wp.array2d(dtype=Any),
    ):
        b, thread = wp.tid()
        if progress.status[b] == SEARCH and may_run(b, progress, limits, segment_end):
            along = wp.tile_load(vectors.directions[b], shape=wp.static(width), storage="shared")
            sink = wp.float32(0.0)
            if gathering.tip_row >= 0:
                sink = along[gathering.tip_row]
            pushing = touch_rates(b, thread, sink, surface, along, contact)
            all_push = wp.tile_sum(wp.tile(pushing))
            pushed = all_push[0]
            for i in range(thread, surface.rest.shape[0] * surface.rest.shape[1], wp.block_dim()):
                spread_contact(i, b, surface, contact)

            part = wp.float64(0.0)
            contributions = wp.tile_zeros(shape=wp.static(room), dtype=wp.float32, storage="shared")
            for c in range(gathering.starts.shape[0]):
                hand_over(c, b, thread, gel, along, tangents, gathering, contributions)
                for row in range(thread, gathering.row_count, wp.block_dim()):
                    y = gathered(row, c, gathering, contributions)
                    if c == 0:
                        y += gathered_contact(row, b, gathering, contact.face_forces)
                    else:
                        y += wp.float64(vectors.rates[b, row])
                    if row == gathering.tip_row:
                        y = -pushed
                    vectors.rates[b, row] = wp.float32(y)
                    if c == gathering.starts.shape[0] - 1:
                        part += y * wp.float64(along[row])
                wait_for_all(contributions)
            all_curvature = wp.tile_sum(wp.tile(part))
            curvature = all_curvature[0]
            advances = curvature > wp.float64(0.0)
            length = progress.scaled[b] / curvature
            is_first = progress.searches[b] == 0
            norm = wp.float32(progress.norm[b])
            for row in range(thread, gathering.row_count, wp.block_dim()):
                if advances:
                    step_on(row, b, length, norm, vectors, sources_out)
                else:
                    take_what_there_is(row, b, is_first, vectors)
            if thread == 0:
                progress.length[b] = length
                progress.act[b] = wp.where(advances, ADVANCE_SEARCH, END_SEARCH)

    return search
