"""Warp kernels of the descent to equilibrium: what each environment does after an evaluation.

An environment runs until it is done, or until it asks the host for what a kernel has not: a factor,
a start that is not inside out, an error. ``judge`` decides, by ``line_search_and_convergence``;
``prepare`` takes over what was accepted and says what the inverse is asked for; ``turn`` makes a
direction of the answer and goes along it. ``dofs`` are the places of the unknowns in the flat nodal
vector. A block of threads has one environment, so that sums are known to all; on the CPU it is one
thread. Device code has no membership test.
"""

from functools import cache
from typing import Any

import warp as wp

from sim.solve.descent_state import Act, Descent, Evaluated, Limits, Mode, Pull, Status
from sim.solve.lbfgs_kernels import (
    Memory,
    add_all,
    first_loop,
    note_products,
    products_with,
    second_loop,
    wait_for_all,
)
from sim.solve.line_search_and_convergence import (
    CUT,
    FAR,
    NOTHING_AT_ALL,
    Sum,
    Sums,
    decide,
    finds_no_descent,
)


@wp.func
def with_gradient(
    sums: Sums, g: wp.float64, memory: Memory, b: wp.int32, row: wp.int32, mode: wp.int32
):
    """Note an unknown's part of the gradient [N], and return the sums with it."""
    if mode == Mode.HELD:
        memory.renewed[b, row] = g
    else:
        memory.trial[b, row] = g
    change = g - memory.gradient[b, row]
    sums[Sum.SLOPE] += g * memory.direction[b, row]
    sums[Sum.SQUARE] += g * g
    sums[Sum.CHANGE] += change * change
    return sums


@cache
def descent_kernels(*, grips: bool, pulls: bool, threads: int) -> tuple[Any, Any, Any]:
    """Build judge, prepare and turn; each launches over [environment_count, threads of a block].

    Args:
        grips: Points that touch hold on to the indenter.
        pulls: Nodes have further energies.
    """
    made = {"enable_backward": False, "module": "unique", "launch_bounds": threads}

    @wp.kernel(**made)
    def judge(
        # Model:
        limits: Limits,
        dofs: wp.array(dtype=wp.int32),
        pull: Pull,
        # Data in:
        evaluated: Evaluated,
        # Data in and out:
        d: Descent,
        memory: Memory,
        again: wp.bool,
        # Data out:
        busy_out: wp.array(dtype=wp.int32),
    ):
        # ``again`` looks once more at what is held anew.
        b, thread = wp.tid()
        runs = d.status[b] == Status.RUNNING
        if again:
            runs = d.holding[b] > 0
        elif thread == 0:
            busy_out[0] = 0
            d.act[b] = Act.NOTHING
            d.wanted[b] = 0
            d.holding[b] = 0
            d.takes[b] = 0
            d.learns[b] = 0
        if runs:
            mode = d.mode[b]
            looks = mode < Mode.GO  # it begins, tries or is held anew
            push = d.push[b]
            dof_count = dofs.shape[0]
            sums = Sums()
            # The smallest volume ratio, gap, and share of the step that overlap allows.
            least = wp.vec3d(wp.float64(FAR), wp.float64(FAR), wp.float64(1.0))
            if looks:
                for n in range(thread, evaluated.contact.shape[1] / 3, wp.block_dim()):
                    for k in range(3):
                        sums[Sum.PUSH + k] += evaluated.contact[b, 3 * n + k]
                for row in range(thread, dof_count, wp.block_dim()):
                    dof = dofs[row]
                    g = evaluated.elastic[b, dof] + evaluated.contact[b, dof]
                    if wp.static(pulls):
                        x = evaluated.positions[b, dof]
                        away = x - pull.towards[dof]
                        drawn = pull.stiffness[dof] * away
                        g += drawn - pull.force[dof]
                        sums[Sum.ENERGY] += wp.float64(0.5) * drawn * away
                        sums[Sum.ENERGY] -= pull.force[dof] * (x - pull.rest[dof])
                    if dof % 3 == 2:
                        sums[Sum.VERTICAL] += g
                    sums = with_gradient(sums, g, memory, b, row, mode)
                for e in range(thread, evaluated.energies.shape[1], wp.block_dim()):
                    sums[Sum.ENERGY] += evaluated.energies[b, e]
                    least[0] = wp.min(least[0], evaluated.ratios[b, e])
                for p in range(thread, evaluated.gaps.shape[1], wp.block_dim()):
                    sums[Sum.ENERGY] += evaluated.touched[b, p]
                    there = evaluated.gaps[b, p]
                    least[1] = wp.min(least[1], there)
                    if mode == Mode.TRY:
                        before = memory.gaps[b, p]
                        floor = wp.min(before, wp.float64(0.0)) - limits.overlap
                        if there < floor:
                            fall = wp.max(before - there, NOTHING_AT_ALL)
                            least[2] = wp.min(least[2], wp.min(CUT, (before - floor) / fall))
                    if wp.static(grips):  # noqa: SIM102 - decided when it is compiled
                        if mode == Mode.HELD:
                            sums[Sum.GRIP] += evaluated.grip_change[b, p]
                            sums[Sum.LIMIT] += evaluated.grip_limit[b, p]
            all_sums = wp.tile_sum(wp.tile(sums, preserve_type=True))
            all_least = wp.tile_reduce(wp.min, wp.tile(least, preserve_type=True))
            total = all_sums[0]
            mins = all_least[0]
            if thread == 0:
                if looks:
                    push = wp.vec3d(total[Sum.PUSH], total[Sum.PUSH + 1], total[Sum.PUSH + 2])
                    d.push[b] = push
                    g = wp.float64(0.0)
                    if d.pushed[b] == 1:
                        g = d.load[b] - push[2]
                        total[Sum.ENERGY] += d.load[b] * evaluated.tips[b][2]
                    total = with_gradient(total, g, memory, b, dof_count, mode)
                decide(d, memory, b, limits, total, mins, push)
            wait_for_all()
            if d.takes[b] == 1:
                for p in range(thread, evaluated.gaps.shape[1], wp.block_dim()):
                    memory.gaps[b, p] = evaluated.gaps[b, p]

    @wp.kernel(**made)
    def prepare(
        # Model:
        dofs: wp.array(dtype=wp.int32),
        scaled: wp.bool,
        weights: wp.array(dtype=wp.float32),
        # Data in and out:
        d: Descent,
        evaluated: Evaluated,
        memory: Memory,
        # Data out:
        sources_out: wp.array2d(dtype=Any),
    ):
        # With ``scaled`` what the inverse is asked for is in units of the residual; times weights.
        b, thread = wp.tid()
        act = d.act[b]
        learns = d.learns[b] == 1
        held = d.holding[b] > 0
        dof_count = dofs.shape[0]
        length = memory.table.shape[1]
        if d.takes[b] == 1:
            at = wp.int32(0)
            if learns:
                at = memory.next[b]
            fraction = d.fraction[b]
            curvature = wp.float64(0.0)
            for row in range(thread, dof_count + 1, wp.block_dim()):
                x = evaluated.tips[b][2]
                if row < dof_count:
                    x = evaluated.positions[b, dofs[row]]
                memory.start[b, row] = x
                g = memory.trial[b, row]
                if learns:
                    step = fraction * memory.direction[b, row]
                    change = g - memory.gradient[b, row]
                    memory.steps[b, at, row] = wp.float32(step)
                    memory.changes[b, at, row] = wp.float32(change)
                    curvature += step * change
                memory.gradient[b, row] = g
            if learns:
                own = wp.tile_sum(wp.tile(curvature))
                s_y = own[0]
                if thread == 0:
                    memory.next[b] = (at + 1) % length
                    memory.counts[b] = wp.min(memory.counts[b] + 1, length)
                wait_for_all()
                count = memory.counts[b]
                products_with(memory.steps, memory.gradient, count, b, memory.products)
                note_products(memory, b, fraction, s_y)
            if held:
                for row in range(thread, dof_count + 1, wp.block_dim()):
                    memory.gradient[b, row] = memory.renewed[b, row]
        if act != Act.NOTHING and act != Act.BACK:
            for i in range(thread, evaluated.elastic.shape[1], wp.block_dim()):
                evaluated.elastic[b, i] = wp.float64(0.0)
                evaluated.contact[b, i] = wp.float64(0.0)
        if act == Act.SOLVE:
            count = memory.counts[b]
            if held or not learns:
                wait_for_all()
                products_with(memory.steps, memory.gradient, count, b, memory.products)
            first_loop(memory, b)
            down = wp.float64(-1.0)
            gradient = memory.gradient
            add_all(memory.changes, memory.shares, count, b, down, gradient, memory.direction)
            scale = wp.float64(1.0)
            if scaled:
                scale = wp.float64(1.0) / d.residual[b]
            for row in range(thread, dof_count + 1, wp.block_dim()):
                asked = scale * wp.float64(weights[row]) * memory.direction[b, row]
                sources_out[d.slot[b], row] = sources_out.dtype(asked)

    @wp.kernel(**made)
    def turn(
        # Model:
        limits: Limits,
        dofs: wp.array(dtype=wp.int32),
        scaled: wp.bool,
        units: wp.array(dtype=wp.float64),
        weights: wp.array(dtype=wp.float32),
        # Data in:
        found: wp.array2d(dtype=Any),
        # Data in and out:
        d: Descent,
        memory: Memory,
        # Data out:
        evaluated: Evaluated,
        busy_out: wp.array(dtype=wp.int32),
    ):
        # The inverse's answer is ``found`` times ``units`` and ``weights``, and times the residual
        # if ``scaled``.
        b, thread = wp.tid()
        act = d.act[b]
        dof_count = dofs.shape[0]
        fraction = d.fraction[b]
        if act == Act.SOLVE:
            fraction = wp.where(d.pushed[b] == 0, d.first_try[b], wp.float64(1.0))
            count = memory.counts[b]
            scale = units[b]
            if scaled:
                scale = scale * d.residual[b]
            for row in range(thread, dof_count + 1, wp.block_dim()):
                r = scale * wp.float64(weights[row]) * wp.float64(found[d.slot[b], row])
                if row == dof_count and d.pushed[b] == 0:
                    r = wp.float64(0.0)
                memory.direction[b, row] = r
            wait_for_all()
            products_with(memory.changes, memory.direction, count, b, memory.products)
            second_loop(memory, b)
            as_is = wp.float64(1.0)
            direction = memory.direction
            add_all(memory.steps, memory.shares, count, b, as_is, direction, direction)
            part = wp.vec2d()
            for row in range(thread, dof_count + 1, wp.block_dim()):
                r = memory.direction[b, row]
                part += wp.vec2d(r * memory.gradient[b, row], r * r)
            all_parts = wp.tile_sum(wp.tile(part, preserve_type=True))
            along = all_parts[0]
            falls = along[0] < wp.float64(0.0)
            if not falls:
                fraction = wp.float64(0.0)
            sinks = wp.abs(memory.direction[b, dof_count])
            if fraction * sinks > limits.tip_step:
                fraction = limits.tip_step / sinks
            if thread == 0:
                d.slope[b] = along[0]
                d.length[b] = along[1]
                d.fraction[b] = fraction
                d.tries[b] = 0
                d.mode[b] = Mode.TRY
                if not falls:
                    d.wanted[b] = 0
                    finds_no_descent(d, memory, b)
        if act == Act.BACK:
            fraction = wp.float64(0.0)
        if act != Act.NOTHING:
            for row in range(thread, dof_count + 1, wp.block_dim()):
                x = memory.start[b, row] + fraction * memory.direction[b, row]
                if row < dof_count:
                    evaluated.positions[b, dofs[row]] = x
                elif d.pushed[b] == 1:
                    tip = evaluated.tips[b]
                    evaluated.tips[b] = wp.vec3d(tip[0], tip[1], x)
        if thread == 0:
            if limits.keeps and d.status[b] == Status.ASKS_FACTOR:
                memory.counts[b] = 0
                memory.next[b] = 0
                d.first_try[b] = wp.float64(1.0)
                d.since[b] = 0
                d.mode[b] = Mode.GO
                d.status[b] = Status.RUNNING
            if d.status[b] == Status.RUNNING:
                busy_out[0] = 1

    return judge, prepare, turn
