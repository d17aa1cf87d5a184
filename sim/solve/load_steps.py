"""The phases of a loading path, and the load steps along them.

A phase moves the indenter along one growing or falling parameter. A step starts from the
prediction of the points before it, or from the tangent's, and is cut where it fails.
"""

import logging
import math
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim.contact.surface_and_grip import State
from sim.material.relaxation import Relaxation
from sim.scene.indenter import Indenter, MeshIndenter
from sim.solve.equilibrium import Equilibrium, EquilibriumSolver, Reuse, SolverOptions
from sim.solve.model import Model
from sim.solve.path_point import PathCounts, PathPoint, predicted_state
from sim.solve.refused_overlap import base_depth_m, overlap_fraction
from sim.solve.weight_and_inertia import Inertia, Potential
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError, ConvergenceError
from tacauchy_rig.core.time_limit_and_progress import doing

logger = logging.getLogger(__name__)

_DOWN = np.array([0.0, 0.0, -1.0])
_STILL = np.zeros(3)
# No stiffness [N/m], or no travel [m]: it keeps quotients finite.
_NOTHING = 1e-30
# Of the pad's height: the longest step, if nothing else is said. Twice as long is faster, but a
# ball of 6 mm then caught a coarse gel's face at twice the energy.
STEP_SHARE = 0.0125
# A push's steps are at least this share of its force, also where the gel hardly resists.
_FORCE_STEP_MIN_SHARE = 1e-3
# Of the longest step: a press that fails in shorter ones stops.
_STEP_MIN_SHARE = 2e-5
# Of the longest step: what overlap leaves of a step must be more, or the step is refused.
_OVERLAP_LEFT_MIN_SHARE = 1e-6
# Of the pad's height: first touch is found to less.
_TOUCHES_FROM_SHARE = 1e-6
# A press also stops where so many steps failed and those between brought it no farther than this
# share of the longest step.
_FAILED_STEPS, _PROGRESS_LEAST_SHARE = 8, 0.25
# Steps are cut by this where they fail, and may grow by the other where they do not.
_CUT, _GROWTH = 4.0, 2.0
# Of a phase, where a gel relaxes: its stress is taken to change evenly in a step.
_EVEN_SHARE = 0.1
# A step may be longer by this share, so that rounding takes no step of its own.
_LONGER = 1e-3
# Points of the path that the next one may be predicted from.
_REMEMBERED = 24
# Of d_hat: a prediction that overlaps more is none. After gel slipped it would slip again so far.
_PREDICTED_OVERLAP = 0.4
# Residual over the contact force of an intermediate state, and over that of the last one where the
# depth is given. The next one is extrapolated from these, the better the more exact they are.
_INTERMEDIATE, _OVER_LAST = 1e-4, 10.0
# Of F_z: a smaller change tells no stiffness; intermediate states meet it to a tenth of that.
_TELLS_STIFFNESS = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """One parameter from ``start`` to ``end``: here, straight down to a depth [m]."""

    start: float
    end: float
    goal: str  # what is to be reached, for messages
    exact: float  # difference from the end that counts as none
    step_max_m: float  # longest travel of a point of the indenter in one step [m]
    load_n: float | None = None  # F_z to keep, while the depth follows [N]
    twist_rad: float = 0.0  # turn about z through the tip for one of the parameter [rad]

    @property
    def direction(self) -> tuple[object, ...]:
        """Phases of equal direction continue one another."""
        return type(self), self.end > self.start

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        return abs(self.end - at) > self.exact

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002
        """Return the longest step of the parameter; dF_z / d(depth) is given [N/m]."""
        return self.step_max_m

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity [m/unit] and spin [rad/unit] of the indenter, shape [3] each."""
        return _DOWN, _STILL

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:
        """Return the rotation after a step about the pad's z."""
        angle = self.twist_rad * advance
        c, s = np.cos(angle), np.sin(angle)
        return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation)

    def load_at(self, at: float) -> float | None:  # noqa: ARG002
        """Return the force that is to be carried there [N]; None where the depth is given."""
        return self.load_n


class ForcePhase(Phase):
    """Straight down until a force F_z [N] is carried."""

    def longest(self, stiffness_n_m: float) -> float:
        """Return the force of the longest advance [N]."""
        return max(stiffness_n_m * self.step_max_m, _FORCE_STEP_MIN_SHARE * self.end)

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity and spin for a newton."""
        return _DOWN / max(stiffness_n_m, _NOTHING), _STILL

    def load_at(self, at: float) -> float | None:
        """Return the force itself."""
        return at


@dataclass(frozen=True, slots=True, kw_only=True)
class CarryPhase(Phase):
    """Along the pad and about z, from 0 to 1."""

    shift_m: FloatArray  # whole translation [m], shape [3]
    radius_m: float  # radius of the contact [m], which turns an angle into a travel
    start: float = 0.0
    end: float = 1.0
    exact: float = 1e-9

    @property
    def direction(self) -> tuple[object, ...]:
        """Phases of equal direction continue one another."""
        return type(self), *self.shift_m.tolist(), self.twist_rad, self.load_n is None

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002
        """Return the longest step: the one in which a point of the rim travels ``step_max_m``."""
        travel = float(np.linalg.norm(self.shift_m)) + abs(self.twist_rad) * self.radius_m
        return min(1.0, self.step_max_m / max(travel, _NOTHING))

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin over the whole phase."""
        return self.shift_m, np.array([0.0, 0.0, self.twist_rad])


@dataclass(slots=True)
class Stepping:
    """Steps one indenter through equilibria of a pad; a gel that relaxes or has mass remembers."""

    model: Model
    indenter: Indenter
    centre_m: tuple[float, float] = (0.0, 0.0)  # where its tip comes down, x and y [m]
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))  # indenter to pad frame
    step_max_m: float = 0.0  # largest advance [m]; 0 chooses an eightieth of the pad's height
    options: SolverOptions = field(default_factory=SolverOptions)
    potential: Potential | None = None  # energy of the nodes besides inertia, such as weight
    inertia: Inertia | None = None  # mass of the nodes, for a path in time
    reuse: Reuse | None = None  # what the solver keeps between steps; None as the size calls for
    keeps_all: bool = False  # keep every equilibrium, not the last ones only
    rounder: Indenter | None = None  # gel slips past its rim first where a phase ends
    counts: PathCounts = field(default_factory=PathCounts)
    solver: EquilibriumSolver = field(init=False)
    touch_m: float = field(init=False)  # tip height from which depth counts [m]
    # The equilibrium that was reached last, also when a phase ended in an error.
    last: PathPoint | None = field(init=False, default=None)
    # (depth [m], F_z [N]) of every equilibrium so far, intermediate ones to 0.1 %.
    history: list[tuple[float, float]] = field(init=False, default_factory=list)
    # The last of these equilibria; all of them if ``keeps_all``.
    points: deque[PathPoint] = field(init=False)
    # Points of the phases of one direction, with their places along it.
    _alike: deque[tuple[float, PathPoint]] = field(
        init=False, default_factory=lambda: deque(maxlen=_REMEMBERED)
    )
    _direction: tuple[object, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        if self.step_max_m == 0.0:
            self.step_max_m = STEP_SHARE * self.model.height_m
        self.points = deque(maxlen=None if self.keeps_all else _REMEMBERED)
        self.solver = EquilibriumSolver(self.model, self.indenter, self.potential, reuse=self.reuse)

    @property
    def blunted_m(self) -> float:
        """By how much rounding cut off the indenter's tip [m]."""
        return self.indenter.blunted_m if isinstance(self.indenter, MeshIndenter) else 0.0

    @property
    def memories(self) -> tuple[Inertia | Relaxation, ...]:
        """What goes on from where a step ended, and not from any point of the path."""
        return tuple(each for each in (self.model.relaxation, self.inertia) if each is not None)

    def base_depth_m(self, from_m: float) -> float:
        """Return where the indenter is at the gel's base [m], or if not from here on, any less."""
        half = np.abs(self.model.nodes[:, :2]).max(axis=0)
        at = {"reach_m": np.stack([-half, half]) - np.array(self.centre_m), "touch_m": self.touch_m}
        return base_depth_m(self.indenter, self.rotation, **at, from_m=from_m)

    def must_touch(self, depth_m: float) -> bool:
        """Return whether an indenter that came down to a depth [m] cannot but touch."""
        deep = depth_m - self.blunted_m > _TOUCHES_FROM_SHARE * self.model.height_m
        return deep and not self.memories

    def begin(self, duration_s: float | None) -> None:
        """Begin a step of a time [s]; None is for ever."""
        for memory in self.memories:
            memory.begin_step(math.inf if duration_s is None else duration_s)
        if self.inertia is not None:
            self.solver.replace_potential(self.inertia.flight(self.potential))

    def accept(self, point: PathPoint) -> PathPoint:
        """Remember a point that is gone on from."""
        self.last = point
        self.points.append(point)
        self.history.append((point.depth_m, float(point.force_n[2])))
        for memory in self.memories:
            memory.commit(point.state.positions)
        return point

    def longest_share(self, duration_s: float | None) -> float:
        """Return the largest part of what takes a time [s] that may be one step."""
        if duration_s is None or not math.isfinite(duration_s):
            return 1.0
        share = 1.0 if self.model.relaxation is None else _EVEN_SHARE
        if self.inertia is not None:
            share = min(share, self.inertia.step_max_s / duration_s)
        return share

    def go(self, point: PathPoint, phase: Phase, duration_s: float | None) -> PathPoint:
        """Go along a phase from a point, the last one or an earlier.

        Raises:
            ConvergenceError: An increment failed even at the smallest step; ``last`` was reached.
            ConfigError: A gel that relaxes or has mass would have to go back.
        """
        started = time.perf_counter()
        if point is not self.last and self.memories:
            raise ConfigError(
                "a gel that relaxes or has mass cannot go back to an earlier point of its path",
                remedy="drive it by load or by depth, not by the displacement search",
            )
        self.last = point
        whole = abs(phase.end - phase.start)
        pace = None if duration_s is None else duration_s / max(whole, 1e-300)
        even = whole * self.longest_share(duration_s)
        if phase.direction != self._direction or self._alike[-1][1] is not point:
            self._alike.clear()
            self._alike.append((phase.start, point))
            self._direction = phase.direction
        at, step, failed_at = phase.start, min(phase.longest(point.stiffness_n_m), even), []
        with doing(f"pressing to {phase.goal}") as tell:
            while phase.is_short_of(at):
                left = phase.end - at
                advance = float(np.clip(left, -step, step))
                if self.inertia is not None:
                    # Parted evenly: a sliver of time at the end would turn rounding into speed.
                    advance = left / max(1, math.ceil(abs(left) / step - _LONGER))
                try:
                    found, taken = self._increment(point, phase, at, advance, pace)
                except ConvergenceError as error:
                    step = abs(advance) / _CUT
                    failed_at.append(at)
                    logger.debug("increment of %.3g failed: %s", advance, error.message)
                    longest = phase.longest(point.stiffness_n_m)
                    hardly_moves = len(failed_at) >= _FAILED_STEPS and (
                        abs(at - failed_at[-_FAILED_STEPS]) < _PROGRESS_LEAST_SHARE * longest
                    )
                    if step < longest * _STEP_MIN_SHARE or hardly_moves:
                        raise ConvergenceError(
                            f"the press stopped at {point.depth_m * 1e3:.4f} mm and "
                            f"{point.force_n[2]:.4f} N on the way to {phase.goal}: "
                            f"{error.message}",
                            remedy=error.remedy,
                        ) from error
                    continue
                base_m = self.base_depth_m(found.depth_m)
                if found.depth_m >= base_m:  # shorter steps would lead there too
                    raise ConvergenceError(
                        f"the gel does not carry {phase.goal}: at {point.force_n[2]:.4f} N the "
                        f"indenter is {point.depth_m * 1e3:.4f} mm deep, and at "
                        f"{base_m * 1e3:.4f} mm it is at the gel's base",
                        remedy="press with less force",
                    )
                point = self.accept(found)
                tell(f"{point.depth_m * 1e3:.4f} mm, {point.force_n[2]:.4f} N")
                self._alike.append((self._alike[-1][0] + taken, point))
                at = phase.end if abs(phase.end - at - taken) <= phase.exact else at + taken
                grown = _GROWTH * max(step, abs(taken))
                step = min(phase.longest(point.stiffness_n_m), grown, even)
        self.counts.wall_s += time.perf_counter() - started
        return point

    def _increment(
        self, point: PathPoint, phase: Phase, at: float, advance: float, pace: float | None
    ) -> tuple[PathPoint, float]:
        """Go one step; return where that led and how much of the phase was done."""
        state, fraction = self._predicted(point, phase, at, advance), 1.0
        if state is None:
            state, fraction = self._along_tangent(point, phase, advance)
        self.begin(None if pace is None else pace * fraction * abs(advance))
        taken = fraction * advance
        found = self.settle(
            state,
            load_n=phase.load_at(at + taken),
            must_touch=type(phase) is Phase and advance > 0.0 and self.must_touch(at + taken),
            intermediate=self.inertia is None and phase.is_short_of(at + taken),
            before=point,
            ends=not phase.is_short_of(at + taken),
        )
        return found, taken

    def _along_tangent(self, point: PathPoint, phase: Phase, advance: float) -> tuple[State, float]:
        """Return where the tangent leads, and the fraction of the step that overlap allows."""
        state = point.state.copy()
        # The stiffness of a state before would be that of another contact.
        self.solver.take_factor(state)
        velocity, spin = phase.rate(point.stiffness_n_m)
        motion, lift = self._response(point, velocity, spin)
        if phase.load_n is not None:
            sunk, resists = self._response(point, _DOWN, _STILL)
            sink = -lift / max(resists, _NOTHING)
            motion = motion + sink * sunk
            velocity = velocity + sink * _DOWN
        tip = state.tip + advance * velocity
        state.rotation = phase.turned(state.rotation, advance)
        fraction = overlap_fraction(self.model, self.indenter, state, tip, advance * motion)
        if np.any(spin) and fraction < 1.0:
            raise ConvergenceError("the next turn would overlap the indenter")
        if fraction * abs(advance) < phase.longest(point.stiffness_n_m) * _OVERLAP_LEFT_MIN_SHARE:
            raise ConvergenceError("the next step would overlap the indenter")
        state.positions = state.positions + fraction * advance * motion
        state.tip = state.tip + fraction * (tip - state.tip)
        return state, fraction

    def _response(
        self, point: PathPoint, velocity: FloatArray, spin: FloatArray
    ) -> tuple[FloatArray, float]:
        """Return how nodes [m/unit] and F_z [N/unit] answer a motion of the indenter."""
        model, contact = self.model, point.equilibrium.contact
        carried = velocity + np.cross(spin, contact.points - point.state.tip)
        change = np.cross(spin, contact.forces)
        change -= np.einsum("fpij,fpj->fpi", contact.stiffness, carried)
        pulled = model.pattern.unknowns(model.surface.scatter(change))
        motion = -model.pattern.nodal(self.solver.factor.solve(pulled))
        lifted = float(np.sum(model.surface.scatter(contact.stiffness[..., 2]) * motion))
        rate = model.mesh.symmetry.copies * (float(change[..., 2].sum()) + lifted)
        return motion, rate

    def _predicted(self, point: PathPoint, phase: Phase, at: float, advance: float) -> State | None:
        """Return the state to which the points so far lead; None where they do not tell enough."""
        known, place = self._basis(point, phase, at)
        model = self.model
        if not point.force_n.any():
            state = point.state.copy()
        elif len(known) > 1:
            places, points = [place for place, _ in known], [each for _, each in known]
            state = predicted_state(points, places, at=place + advance, step=advance)
            state.grip = point.state.copy().grip
            # Nothing brings these back from what a sum of many states rounds.
            state.positions[model.clamped] = model.nodes[model.clamped]
        else:
            return None
        if isinstance(phase, CarryPhase):
            state.rotation = phase.turned(point.state.rotation, advance)
            state.tip[:2] = point.state.tip[:2] + advance * phase.shift_m[:2]
            if phase.load_n is None:
                state.tip[2] = point.state.tip[2]
        elif phase.load_at(at) is None:
            state.tip[2] = self.touch_m - (at + advance)
        if model.contact_options.extension < 1.0:  # a parabola throughout forgives any overlap
            gaps = model.surface.gaps(state.positions, self.indenter, state)
            if not gaps.min() >= -_PREDICTED_OVERLAP * model.contact_options.distance_m:
                return None
        return state

    def _basis(
        self, point: PathPoint, phase: Phase, at: float
    ) -> tuple[list[tuple[float, PathPoint]], float]:
        """Return the points that the next may be predicted from, with their places, and the last's.

        Where an equilibrium depends on the indenter's place alone, those of any phase serve.
        """
        tangential = self.model.contact_options.is_tangential
        if self.memories or tangential or isinstance(phase, CarryPhase):
            return list(self._alike), self._alike[-1][0]
        held = phase.load_at(phase.end) is None
        known = [
            (each.depth_m if held else float(each.force_n[2]), each)
            for each in self.points
            if np.array_equal(each.state.tip[:2], point.state.tip[:2])
            and np.array_equal(each.state.rotation, point.state.rotation)
        ]
        return known, at

    def settle(
        self,
        state: State,
        *,
        load_n: float | None = None,
        must_touch: bool = False,
        intermediate: bool,
        before: PathPoint | None = None,
        ends: bool = False,
    ) -> PathPoint:
        """Find the equilibrium, friction's lagged pressure included, or raise ConvergenceError.

        Args:
            state: Where to start from; it becomes the point's.
            load_n: Force that the indenter is pushed with [N]; None holds it where it is.
            must_touch: An equilibrium in which nothing presses is none.
            intermediate: To 0.01 % or less will do.
            before: The point that was gone on from.
            ends: Go by way of what a rounder rim leads to, which is the same from any start.
        """
        solver, model, options = self.solver, self.model, self.options
        wanted = options.residual_relative
        rougher = max(_INTERMEDIATE, _OVER_LAST * wanted)
        if load_n is not None:
            load_n = load_n / model.mesh.symmetry.copies
            wanted, rougher = min(wanted, options.load_relative), _INTERMEDIATE
        options = replace(options, residual_relative=rougher if intermediate else wanted)
        if ends and self.rounder is not None:
            with suppress(ConvergenceError):
                trial, rough = state.copy(), replace(options, residual_relative=_INTERMEDIATE)
                for body in (self.rounder, self.indenter):
                    slipping = EquilibriumSolver(model, body, solver.factor.potential)
                    slipping.settle(trial, load_n=load_n, options=rough)
                    trial.grip, trial.extension = state.copy().grip, state.extension
                state.positions, state.tip = trial.positions, trial.tip
        found = solver.settle(state, load_n=load_n, must_touch=must_touch, options=options)
        if model.contact_options.bonded:
            model.surface.refresh_grip(solver.indenter, state)
        model.surface.drag_anchors(solver.indenter, state)
        self.counts.newton_iterations += found.iterations
        self.counts.increments += 1
        return self._point(state, found, before)

    def _point(self, state: State, found: Equilibrium, before: PathPoint | None) -> PathPoint:
        force = self.model.mesh.symmetry.whole_force(found.push_n)
        depth = self.touch_m - float(state.tip[2])
        rise, travel, last = float(force[2]), depth, 0.0
        if before is not None:
            rise, travel = rise - float(before.force_n[2]), depth - before.depth_m
            last = before.stiffness_n_m
        is_pressed = rise * travel > 0.0 and abs(rise) > _TELLS_STIFFNESS * abs(float(force[2]))
        return PathPoint(
            depth_m=depth,
            force_n=force,
            stiffness_n_m=rise / travel if is_pressed else last,
            state=state,
            equilibrium=found,
        )
