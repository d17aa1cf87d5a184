"""Warp functions that decide what an environment does after an evaluation.

``sim.solve.equilibrium`` and docs/explanation/solver.md describe the rules.
"""

from enum import IntEnum

import warp as wp

from sim.device import KERNEL_EPSILON
from sim.solve.descent_state import Act, Descent, Limits, Mode, Status
from sim.solve.lbfgs_kernels import Memory

# A residual over the contact force that tells whether the barrier has to be extended less.
_ROUGH = wp.constant(wp.float64(1e-3))
# A residual over the contact force that changes no result that is reported.
_HARMLESS_SHARE = wp.constant(wp.float64(3e-7))
# A residual over the contact force below which it may be rounding's.
_SMALL_SHARE = wp.constant(wp.float64(1e-6))
# The rounding's estimate may be short by this.
_ROUNDING_DOUBT = wp.constant(wp.float64(10.0))
# A standstill: this many steps leave more than this share of the residual before them.
_WINDOW = wp.constant(5)
_LEFT = wp.constant(wp.float64(0.9))
# Share of the slope that a step may end with (Wolfe's second condition; Nocedal and Wright, 3.1):
# a little where rounding hides the energy's change.
_SLOPE_LEFT = wp.constant(wp.float64(0.9))
_SLOPE_LEFT_IN_NOISE = wp.constant(wp.float64(0.3))
# Share of the slope that the energy falls by at least (Armijo; Nocedal and Wright, 3.1).
_ARMIJO = wp.constant(wp.float64(1e-4))
# A step is halved where the energy rises, and shortened to no less than this by the slopes.
_HALF = wp.constant(wp.float64(0.5))
_SHORTEST = wp.constant(wp.float64(0.1))
_TRIES = wp.constant(40)
# Many steps in turn are too long in the same way: each is first tried with the share of its
# direction that would have been best in the last one by the slopes at its ends, but not below the
# shortest and at most so many times what was taken; if rounding hides the energy's change, whole.
_LONGER = wp.constant(wp.float64(1.5))
# At a standstill, a step of so many tries, those cut by overlap among them, ends where the force
# jumps: a point in a corner of a body has two nearest sides, and rests between them.
_TRIES_AT_JUMP = wp.constant(8)
# A motion that overlaps is cut to where the gap falls to the allowed, or by this if that is less.
CUT = wp.constant(wp.float64(0.9))
# Rounding of a sum of energies, in units in the last place of the sum and of E times the volume.
_ROUNDING_OF_SUM = wp.constant(wp.float64(4500.0 * KERNEL_EPSILON))
_ROUNDING_OF_SCALE = wp.constant(wp.float64(4.5 * KERNEL_EPSILON))
# Lagged pressure is taken over where the residual is below this share of the contact force, and, if
# the inverse can be made anew, of the residual when it was taken over last.
_GRIP_FROM = wp.constant(wp.float64(0.1))
_GRIP_AGAIN = wp.constant(wp.float64(0.9))
# After so many steps half of its change is taken over, after twice as many a third, and so on. With
# an inverse that is never made anew ``damping`` follows what the change does. That may oscillate
# for ever around a sharp edge: after ``_LATE`` steps a fixed share of the change is taken over.
_HALF_AFTER = wp.constant(100)
_LATE, _LATE_DAMPING = wp.constant(40), wp.constant(16)
# The friction limit, summed over the points, may still change by this over itself.
_GRIP_CHANGE = wp.constant(wp.float64(1e-4))
_GRIP_PER_RESIDUAL = wp.constant(wp.float64(10.0))
# Under a rim it may change for ever, by 0.1 to 3 %, and F_z by 0.1 %: after ``holds_until`` steps
# it is held where that is at most this over the residual asked, after twice as many the other.
_GRIP_AT_LAST, _GRIP_AT_RIM = wp.constant(wp.float64(1e4)), wp.constant(wp.float64(1e-2))
# Steps with less curvature are not learnt from: s . y over |s| |y|, which rounding would decide.
_CURVATURE_MIN = wp.constant(wp.float64(1e-12))
# A change of a gap, or a force, that is none; it keeps quotients finite.
NOTHING_AT_ALL = wp.constant(wp.float64(1e-300))
FAR = wp.constant(wp.float64(1e300))


class Sum(IntEnum):
    """Sums over an environment."""

    ENERGY = 0  # [J]
    SLOPE = 1  # gradient . direction [J]
    SQUARE = 2  # gradient . gradient [N^2]
    CHANGE = 3  # of the gradient, squared [N^2]
    VERTICAL = 4  # of the gradient along z [N]
    GRIP = 5  # change of the friction limit [N]
    LIMIT = 6  # the friction limit [N]
    PUSH = 7  # x, y and z of the force on the indenter [N]


Sums = wp.types.vector(len(Sum) + 2, wp.float64)


@wp.func
def _asked(d: Descent, b: wp.int32) -> wp.float64:
    return wp.max(d.relative[b] * d.scale[b], d.floor[b])


@wp.func
def _is_held_for_good(d: Descent, b: wp.int32, limits: Limits) -> wp.bool:
    """Return whether lagged pressure is taken over no more."""
    late, later = d.recorded[b] >= limits.holds_until, d.recorded[b] / 2 >= limits.holds_until
    change = d.grip_change[b]
    return (later and change <= _GRIP_AT_RIM) or (late and change <= _GRIP_AT_LAST * d.relative[b])


@wp.func
def note_residual(residuals: wp.array(dtype=wp.float64), residual: wp.float64):
    """Put a residual before the last ones."""
    for k in range(_WINDOW):
        residuals[_WINDOW - k] = residuals[_WINDOW - 1 - k]
    residuals[0] = residual


@wp.func
def stagnates(residuals: wp.array(dtype=wp.float64), recorded: wp.int32) -> wp.bool:
    """Return whether the last steps took less than a tenth off the residual before them."""
    least = residuals[0]
    for k in range(1, _WINDOW):
        least = wp.min(least, residuals[k])
    return recorded > _WINDOW and least > _LEFT * residuals[_WINDOW]


@wp.func
def finds_no_descent(d: Descent, memory: Memory, b: wp.int32):
    """Ask for another factor after a direction along which the energy does not fall."""
    if memory.counts[b] > 0 or d.since[b] > 0:
        d.status[b] = Status.ASKS_FACTOR
    elif d.attempt[b] == 0:
        d.status[b] = Status.ASKS_SAFER_FACTOR
    else:
        d.status[b] = Status.NO_DESCENT


@wp.func
def _check_convergence(d: Descent, b: wp.int32, limits: Limits):
    """Apply the rule for the end of the steps, and go on where it does not hold."""
    last = d.residual[b]
    asked = _asked(d, b)
    scale = d.scale[b]
    is_last = d.recorded[b] - 1 >= d.steps_max[b]
    settled = d.grip_change[b] <= wp.max(_GRIP_CHANGE, _GRIP_PER_RESIDUAL * d.relative[b])
    if scale == wp.float64(0.0) or _is_held_for_good(d, b, limits):
        settled = wp.bool(True)  # what touches nothing has no pressure to take over
    # Small parts of one sign add up to more along z than their norm says.
    if last <= asked and wp.abs(d.vertical[b]) <= asked and settled:
        d.status[b] = Status.DONE
        return
    still = stagnates(d.residuals[b], d.recorded[b])
    if is_last or still or last <= _SMALL_SHARE * scale:
        rounding = d.rounding[b]
        if last <= rounding and settled:
            d.status[b] = Status.DONE
            return
        harmless = wp.max(_HARMLESS_SHARE * scale, _ROUNDING_DOUBT * rounding)
        if still and d.tries[b] >= _TRIES_AT_JUMP and not limits.keeps:
            harmless = wp.max(harmless, _ROUGH * scale)
        if last <= harmless and settled:
            if is_last or (still and d.since[b] <= _WINDOW):
                d.status[b] = Status.DONE
                return
            if still:
                d.status[b] = Status.ASKS_FACTOR
                return
        if is_last:
            d.status[b] = Status.OUT_OF_STEPS
            return
    for k in range(3):
        late = d.since[b] >= limits.patience_steps[k]
        if late and last > limits.patience_shares[k] * scale:
            d.status[b] = Status.ASKS_FACTOR
            return
    d.act[b] = Act.SOLVE


@wp.func
def _assess(d: Descent, b: wp.int32, limits: Limits, grip: wp.float64):
    """Look at a state that was accepted: hold on anew, end or go on."""
    residual = d.residual[b]
    if limits.lags:
        if d.mode[b] == Mode.HELD:
            if limits.keeps:
                n, before = d.damping[b], d.grip_change[b]
                if grip > before:  # it goes up and down in turn
                    d.damping[b] = n + 1
                elif grip < (wp.float64(1.0) - _HALF / wp.float64(n)) * before:
                    d.damping[b] = wp.max(n - 1, 1)
            else:
                d.gripped_at[b] = residual
            d.grip_change[b] = grip
        else:
            due = wp.min(_GRIP_FROM * d.scale[b], _GRIP_AGAIN * d.gripped_at[b])
            if d.mode[b] == Mode.BEGIN:
                due = wp.float64(0.0)  # what a start overlaps is no pressure
            if residual <= wp.max(due, _asked(d, b)) and not _is_held_for_good(d, b, limits):
                d.mode[b] = Mode.HELD
                d.holding[b] = 1 + d.recorded[b] / _HALF_AFTER
                if limits.keeps:
                    d.holding[b] = wp.where(d.recorded[b] >= _LATE, _LATE_DAMPING, d.damping[b])
                return
    note_residual(d.residuals[b], residual)
    d.recorded[b] = d.recorded[b] + 1
    if not wp.isfinite(residual):
        d.status[b] = Status.NOT_FINITE
        return
    if d.rough[b] == 1 and residual <= _ROUGH * d.scale[b]:
        # Where the barrier has to be extended less, the rest would be for nothing.
        d.rough[b] = 0
        if d.gap_min[b] < d.gap_least[b]:
            d.status[b] = Status.TOO_NEAR
            return
    _check_convergence(d, b, limits)


@wp.func
def _line_search(
    d: Descent, memory: Memory, b: wp.int32, limits: Limits, sums: Sums, allowed: wp.float64
) -> wp.bool:
    """Return whether a step is accepted; shorten it where it is not."""
    d.tries[b] = d.tries[b] + 1
    fraction = d.fraction[b]
    slope = d.slope[b]
    size = wp.abs(slope)
    ahead = sums[Sum.SLOPE]
    if allowed < wp.float64(1.0):
        fraction = fraction * allowed
    else:
        before = d.energy[b]
        change = sums[Sum.ENERGY] - before
        # Rounding of the summed energy: below it only the gradient can tell which way is down.
        noise = _ROUNDING_OF_SUM * wp.abs(before) + _ROUNDING_OF_SCALE * limits.energy_scale
        in_noise = wp.abs(change) <= noise
        left = wp.where(in_noise, _SLOPE_LEFT_IN_NOISE, _SLOPE_LEFT)
        falls = in_noise or change <= _ARMIJO * fraction * slope
        if falls and ahead <= left * size:
            d.takes[b] = 1
            share = fraction * size / wp.max(size + ahead, size / _LONGER)
            best = wp.where(in_noise and not limits.keeps, wp.float64(1.0), share)
            d.first_try[b] = wp.clamp(best, _SHORTEST, wp.float64(1.0))
            curvature = ahead - slope
            least = _CURVATURE_MIN * wp.sqrt(d.length[b]) * wp.sqrt(sums[Sum.CHANGE])
            if curvature > least and memory.table.shape[1] > 0:
                d.learns[b] = 1
            d.steps[b] = d.steps[b] + 1
            d.since[b] = d.since[b] + 1
            return wp.bool(True)
        if ahead > wp.float64(0.0):
            fraction = fraction * wp.max(_SHORTEST, size / (size + ahead))
        else:
            fraction = fraction * _HALF
    d.fraction[b] = fraction
    d.act[b] = Act.SHORTEN
    if d.tries[b] >= _TRIES:
        d.act[b] = Act.BACK
        finds_no_descent(d, memory, b)
    return wp.bool(False)


@wp.func
def decide(
    d: Descent,
    memory: Memory,
    b: wp.int32,
    limits: Limits,
    sums: Sums,
    mins: wp.vec3d,
    push: wp.vec3d,
):
    """Decide what an environment does, of what was summed up over it and its smallest numbers.

    Args:
        mins: Volume ratio, gap [m], and share of a step that overlap allows.
        push: Force on the indenter [N].
    """
    mode = d.mode[b]
    if mode == Mode.GO:
        d.act[b] = Act.SOLVE
    else:
        accepted = wp.bool(True)
        if mode != Mode.HELD:
            d.evaluations[b] = d.evaluations[b] + 1
        if mode == Mode.TRY:
            accepted = _line_search(d, memory, b, limits, sums, mins[2])
        else:
            d.takes[b] = 1
        if accepted:
            d.energy[b] = sums[Sum.ENERGY]
            d.residual[b] = wp.sqrt(sums[Sum.SQUARE])
            d.vertical[b] = sums[Sum.VERTICAL]
            d.scale[b] = wp.max(wp.length(push), d.load[b])
            d.ratio_min[b] = mins[0]
            d.gap_min[b] = mins[1]
            odd = mins[0] <= wp.float64(0.0) or mins[1] < -wp.float64(2.0) * limits.overlap
            if mode == Mode.BEGIN and d.checked[b] == 0 and odd:
                d.status[b] = Status.ASKS_START
            else:
                grip = sums[Sum.GRIP] / wp.max(sums[Sum.LIMIT], NOTHING_AT_ALL)
                _assess(d, b, limits, grip)
    if d.status[b] == Status.DONE and d.gap_min[b] < d.gap_least[b]:
        d.status[b] = Status.TOO_NEAR
    if d.status[b] == Status.RUNNING and d.act[b] != Act.NOTHING:
        d.wanted[b] = 1
