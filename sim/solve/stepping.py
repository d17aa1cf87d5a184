"""The phases of a loading path, and the load steps along them.

A phase moves the indenter along one growing or falling parameter. A step starts from the
prediction of the points before it, or from the tangent's, and is cut where it fails.
"""

from __future__ import annotations

import logging
import math
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.contact.state import State
from sim.material.relaxation import Relaxation
from sim.solve.equilibrium import SolverOptions
from sim.solve.nodal_energies import Inertia, Potential
from sim.solve.overlap import OVERLAP_SHARE, overlap_fraction
from sim.solve.path_point import PathPoint, Settling
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError, ConvergenceError

DOWN = np.array([0.0, 0.0, -1.0])
STILL = np.zeros(3)
# What is as good as no stiffness [N/m], or no travel [m]: it keeps quotients finite.
_NOTHING = 1e-30
# A push's steps are at least this share of its force, also where the gel hardly resists.
_FORCE_STEP_MIN_SHARE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase(ABC):
    """One parameter from ``start`` to ``end``.

    Attributes:
        goal: What is to be reached, for messages.
        exact: Difference from the end that counts as none.
        step_max_m: Longest way of a point of the indenter in one step [m].
        load_n: F_z to keep, while the depth answers [N]; None keeps or changes the depth.
        twist_rad: Turn about z through the tip for one of the parameter [rad].
    """

    start: float
    end: float
    goal: str
    exact: float
    step_max_m: float
    load_n: float | None = None
    twist_rad: float = 0.0

    @property
    def direction(self) -> tuple[object, ...]:
        """Where it leads: phases alike in it go on from one another."""
        return type(self), self.end > self.start

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        return abs(self.end - at) > self.exact

    @abstractmethod
    def longest(self, stiffness_n_m: float) -> float:
        """Return the longest step of the parameter; dF_z / d(depth) is given [N/m]."""

    @abstractmethod
    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity [m/unit] and spin [rad/unit] of the indenter, shape [3] each."""

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:
        """Return the rotation after a step about the pad's z."""
        angle = self.twist_rad * advance
        c, s = np.cos(angle), np.sin(angle)
        return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation)

    def load_at(self, at: float) -> float | None:  # noqa: ARG002
        """Return the force that is to be carried there [N]; None where the depth is given."""
        return self.load_n


class DepthPhase(Phase):
    """Straight down to a depth [m]."""

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002 - a depth is a depth
        """Return the longest step [m]."""
        return self.step_max_m

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin a metre of depth."""
        return DOWN, STILL


class ForcePhase(Phase):
    """Straight down until a force F_z [N] is carried."""

    def longest(self, stiffness_n_m: float) -> float:
        """Return the longest step [N]: the force of the longest advance."""
        return max(stiffness_n_m * self.step_max_m, _FORCE_STEP_MIN_SHARE * self.end)

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity and spin a newton."""
        return DOWN / max(stiffness_n_m, _NOTHING), STILL

    def load_at(self, at: float) -> float | None:
        """Return the force itself."""
        return at


@dataclass(frozen=True, slots=True, kw_only=True)
class CarryPhase(Phase):
    """Along the pad and about z, from 0 to 1.

    Attributes:
        shift_m: Whole translation [m], shape [3].
        radius_m: Radius of the contact [m], which turns an angle into a travel.
    """

    shift_m: FloatArray
    radius_m: float
    start: float = 0.0
    end: float = 1.0
    exact: float = 1e-9

    @property
    def direction(self) -> tuple[object, ...]:
        """Where it leads: phases alike in it go on from one another."""
        return type(self), *self.shift_m.tolist(), self.twist_rad, self.load_n is None

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002
        """Return the longest step: the one in which a point of the rim goes ``step_max_m``."""
        travel = float(np.linalg.norm(self.shift_m)) + abs(self.twist_rad) * self.radius_m
        return min(1.0, self.step_max_m / max(travel, _NOTHING))

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin over the whole phase."""
        return self.shift_m, np.array([0.0, 0.0, self.twist_rad])


logger = logging.getLogger(__name__)

# Of the longest step: a press that fails in shorter ones stops.
_STEP_MIN_SHARE = 2e-5
# Of the longest step: what overlap leaves of a step must be more, or the step is refused.
_OVERLAP_LEFT_MIN_SHARE = 1e-6
# Steps are cut by this where they fail, and may grow by the other where they do not.
_CUT, _GROWTH = 4.0, 2.0
# Of a phase, where a gel relaxes: its stress is taken to change evenly in a step.
_EVEN_SHARE = 0.1
# A step may be longer by this share, so that rounding takes no step of its own.
_LONGER = 1e-3
# Points of the path that the next one may be predicted from.
_REMEMBERED = 24
# Points that a prediction goes by, at most.
_GONE_BY = 3
# A parabola that leaves the line by more than this share of the line's way tells that the path is
# not smooth, and the line counts. It is 0.05 to 0.25 where gel flows evenly, 0.5 to 4 where a
# frictionless rim gathers it in folds: there a parabola led to another branch with half the force.
_BENT = 0.5
# A stiffness that is none [N/m]; it keeps a quotient finite.
_NOTHING_N_M = 1e-30
# Points nearer to each other than this share of the way ahead say too little.
_APART = 0.05


@dataclass(slots=True, kw_only=True)
class Stepping:
    """Steps through equilibria, and has a gel that relaxes or has mass remember them.

    Attributes:
        potentials: Further energies of the nodes besides inertia, such as weight.
        last: The equilibrium that was reached last, also when a phase ended in an error.
        history: (depth [m], F_z [N]) of every equilibrium on the way.
        known: The last of these; all of them if ``keeps_all``.
    """

    settling: Settling
    potentials: Sequence[Potential] = ()
    inertia: Inertia | None = None
    keeps_all: bool = False
    last: PathPoint | None = None
    history: list[tuple[float, float]] = field(default_factory=list)
    known: deque[PathPoint] = field(init=False)
    # Points of the phases that led the same way, with their places along it.
    _trail: deque[tuple[float, PathPoint]] = field(
        default_factory=lambda: deque(maxlen=_REMEMBERED)
    )
    _direction: tuple[object, ...] = ()

    def __post_init__(self) -> None:
        self.known = deque(maxlen=None if self.keeps_all else _REMEMBERED)

    def begin(self, duration_s: float | None) -> None:
        """Begin a step of a time [s]; None is for ever."""
        for memory in self._memories:
            memory.begin_step(math.inf if duration_s is None else duration_s)
        if self.inertia is not None:
            flight = self.inertia.flight
            self.settling.solver.replace_potentials((*self.potentials, *flight))

    def accept(self, point: PathPoint) -> PathPoint:
        """Remember a point that is gone on from."""
        self.last = point
        self.known.append(point)
        self.history.append((point.depth_m, float(point.force_n[2])))
        for memory in self._memories:
            memory.commit(point.state.positions)
        return point

    def _advance(self, left: float, step: float) -> float:
        """Return how far the next step goes; of a gel with mass what is left is parted evenly.

        A sliver of time at a phase's end would turn rounding into speed.
        """
        if self.inertia is None:
            return float(np.clip(left, -step, step))
        return left / max(1, math.ceil(abs(left) / step - _LONGER))

    def longest_share(self, duration_s: float | None) -> float:
        """Return the largest part of what takes a time [s] that may be one step."""
        if duration_s is None or not math.isfinite(duration_s):
            return 1.0
        share = 1.0 if self.settling.solver.model.relaxation is None else _EVEN_SHARE
        if self.inertia is not None:
            share = min(share, self.inertia.step_max_s / duration_s)
        return share

    @property
    def _memories(self) -> tuple[Inertia | Relaxation, ...]:
        """What goes on from where a step ended, and not from any point of the path."""
        both = (self.settling.solver.model.relaxation, self.inertia)
        return tuple(each for each in both if each is not None)

    def go(
        self, point: PathPoint, phase: Phase, *, duration_s: float | None, options: SolverOptions
    ) -> PathPoint:
        """Go along a phase from a point, the last one or an earlier.

        Raises:
            ConvergenceError: An increment failed even at the smallest step; the message names the
                last depth that was reached, ``last`` holds it.
            ConfigError: A gel that relaxes or has mass would have to go back.
        """
        started = time.perf_counter()
        point = self._resume(point)
        whole = abs(phase.end - phase.start)
        pace = None if duration_s is None else duration_s / max(whole, 1e-300)
        even = whole * self.longest_share(duration_s)
        if phase.direction != self._direction or self._trail[-1][1] is not point:
            self._trail.clear()
            self._trail.append((phase.start, point))
            self._direction = phase.direction
        at, step = phase.start, min(phase.longest(point.stiffness_n_m), even)
        while phase.is_short_of(at):
            advance = self._advance(phase.end - at, step)
            try:
                found, taken = self._increment(point, phase, at, advance, pace, options)
            except ConvergenceError as error:
                step = abs(advance) / _CUT
                logger.debug("increment of %.3g failed: %s", advance, error.message)
                if step < phase.longest(point.stiffness_n_m) * _STEP_MIN_SHARE:
                    raise _stopped(point, phase, error) from error
                continue
            point = self.accept(found)
            self._trail.append((self._trail[-1][0] + taken, point))
            at = phase.end if abs(phase.end - at - taken) <= phase.exact else at + taken
            step = min(phase.longest(point.stiffness_n_m), _GROWTH * max(step, abs(taken)), even)
        self.settling.counts.wall_s += time.perf_counter() - started
        return point

    def _resume(self, point: PathPoint) -> PathPoint:
        if point is self.last:
            return point
        if self._memories:
            raise ConfigError(
                "a gel that relaxes or has mass cannot go back to an earlier point of its path",
                remedy="drive it by load or by depth, not by the displacement search",
            )
        self.last = point
        return point

    def _increment(
        self,
        point: PathPoint,
        phase: Phase,
        at: float,
        advance: float,
        pace: float | None,
        options: SolverOptions,
    ) -> tuple[PathPoint, float]:
        """Go one step; return where that led and how much of the phase was done."""
        ahead = self._predicted(point, phase, at, advance)
        if ahead is not None:
            self.begin(None if pace is None else pace * abs(advance))
            return self._settled(ahead, point, phase, at + advance, options), advance
        settling, found, state = self.settling, point.equilibrium, point.state.copy()
        # That of a state before would answer to other contact.
        settling.solver.take_factor(state)
        velocity, spin = phase.rate(point.stiffness_n_m)
        motion, lift = settling.response(point.state, found, velocity, spin)
        if phase.load_n is not None:
            sunk, resists = settling.response(point.state, found, DOWN, STILL)
            sink = -lift / max(resists, _NOTHING_N_M)
            motion = motion + sink * sunk
            velocity = velocity + sink * DOWN
        turned = phase.turned(state.rotation, advance)
        tip = state.tip + advance * velocity
        state.rotation = turned
        solver = settling.solver
        fraction = overlap_fraction(solver.model, solver.indenter, state, tip, advance * motion)
        if np.any(spin) and fraction < 1.0:
            raise ConvergenceError("the next turn would overlap the indenter")
        if fraction * abs(advance) < phase.longest(point.stiffness_n_m) * _OVERLAP_LEFT_MIN_SHARE:
            raise ConvergenceError("the next step would overlap the indenter")
        state.positions = state.positions + fraction * advance * motion
        state.tip = state.tip + fraction * (tip - state.tip)
        reached = at + fraction * advance
        self.begin(None if pace is None else pace * fraction * abs(advance))
        return self._settled(state, point, phase, reached, options), fraction * advance

    def _alike(
        self, point: PathPoint, phase: Phase, at: float
    ) -> tuple[list[tuple[float, PathPoint]], float]:
        """Return the points that the next may be predicted from, with their places, and the last's.

        Where an equilibrium depends on the indenter's place alone, those of any phase serve.
        """
        model = self.settling.solver.model
        if self._memories or model.contact_options.is_tangential or isinstance(phase, CarryPhase):
            return list(self._trail), self._trail[-1][0]
        held = phase.load_at(phase.end) is None
        known = [
            (each.depth_m if held else float(each.force_n[2]), each)
            for each in self.known
            if np.array_equal(each.state.tip[:2], point.state.tip[:2])
            and np.array_equal(each.state.rotation, point.state.rotation)
        ]
        return known, at

    def _predicted(self, point: PathPoint, phase: Phase, at: float, advance: float) -> State | None:
        """Return the state to which the points so far lead; None where they do not tell enough."""
        known, place = self._alike(point, phase, at)
        if not point.force_n.any():
            state = point.state.copy()
        elif len(known) > 1:
            places, points = [place for place, _ in known], [each for _, each in known]
            state = predicted_state(points, places, at=place + advance, step=advance)
            state.grip = point.state.copy().grip
            # Nothing brings these back from what a sum of many states rounds.
            model = self.settling.solver.model
            state.positions[model.clamped] = model.nodes[model.clamped]
        else:
            return None
        if isinstance(phase, CarryPhase):
            state.rotation = phase.turned(point.state.rotation, advance)
            state.tip[:2] = point.state.tip[:2] + advance * phase.shift_m[:2]
            if phase.load_n is None:
                state.tip[2] = point.state.tip[2]
        elif phase.load_at(at) is None:
            state.tip[2] = self.settling.touch_m - (at + advance)
        return state if self._may_start(state) else None

    def _may_start(self, state: State) -> bool:
        """Return whether a state overlaps no more than its barrier forgives."""
        solver = self.settling.solver
        model = solver.model
        if model.contact_options.extension >= 1.0:
            return True
        gaps = model.surface.gaps(state.positions, solver.indenter, state)
        return bool(gaps.min() >= -OVERLAP_SHARE * model.height_m)

    def _settled(
        self, state: State, point: PathPoint, phase: Phase, at: float, options: SolverOptions
    ) -> PathPoint:
        return self.settling.settle(
            state,
            load_n=phase.load_at(at),
            passing=self.inertia is None and phase.is_short_of(at),
            options=options,
            before=point,
        )


def _stopped(point: PathPoint, phase: Phase, error: ConvergenceError) -> ConvergenceError:
    return ConvergenceError(
        f"the press stopped at {point.depth_m * 1e3:.4f} mm and "
        f"{point.force_n[2]:.4f} N on the way to {phase.goal}: {error.message}",
        remedy=error.remedy,
    )


def predicted_state(
    points: Sequence[PathPoint],
    places: Sequence[float],
    *,
    at: float,
    step: float,
) -> State:
    """Return the state that polynomials through the nearest points give.

    Args:
        points: Equilibria, the last one to go on from.
        places: Their depths [m] or loads [N]; of the last one it need not be the largest.
        at: Where the state is wanted, in the same unit.
        step: Way from the last point to there, likewise.
    """
    chosen: list[int] = []
    for k in sorted(range(len(points)), key=lambda k: abs(places[k] - at)):
        apart = [abs(places[k] - places[j]) for j in chosen]
        if min(apart, default=np.inf) > _APART * abs(step) and len(chosen) < _GONE_BY:
            chosen.append(k)
    state = points[chosen[0]].state.copy()
    last, found = state.positions, _at(points, places, chosen[:2], at)
    if len(chosen) > 2:
        bent = _at(points, places, chosen, at)
        way, off = (float(np.abs(each).max()) for each in (found[0] - last, bent[0] - found[0]))
        found = bent if off <= _BENT * way else found
    state.positions, state.tip = found
    return state


def _at(
    points: Sequence[PathPoint], places: Sequence[float], chosen: Sequence[int], at: float
) -> tuple[FloatArray, FloatArray]:
    """Return positions and tip that the polynomial through the chosen points has at a place [m]."""
    shares = _lagrange([places[k] for k in chosen], at)
    pairs = list(zip(shares, (points[k].state for k in chosen), strict=True))
    positions = np.sum([share * known.positions for share, known in pairs], axis=0)
    return positions, np.sum([share * known.tip for share, known in pairs], axis=0)


def _lagrange(places: Sequence[float], at: float) -> list[float]:
    """Return the share of every place's value in the value at another."""
    return [
        float(np.prod([(at - other) / (place - other) for other in places if other != place]))
        for place in places
    ]
