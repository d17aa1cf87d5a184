"""A loading path: the indenter moved in steps, each started from the tangent's prediction.

The indenter is advanced to a depth, pushed with a force, or carried along and about its axis while
its depth or its force is held. Each of these is a leg with one parameter that grows.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from sim.arrays import FloatArray
from sim.indenter import Indenter
from sim.legs import CarryLeg, DepthLeg, ForceLeg, Leg, Pose
from sim.linear_solver import LinearSolver, linear_solver
from sim.model import Model
from sim.newton import Equilibrium, NewtonOptions, equilibrate
from sim.overlap import OVERLAP_SHARE, overlap_fraction
from sim.potentials import NodalPotential
from sim.problem import Problem
from sim.state import State
from sim.unloaded import unloaded_positions
from tacauchy_rig.errors import ConfigError, ConvergenceError

logger = logging.getLogger(__name__)

# Twice as long is faster, but a ball of 6 mm then caught a coarse gel's face at twice the energy.
_STEP_SHARE = 0.0125
_STEP_MIN_SHARE = 2e-5
_DEPTH_EXACT_SHARE = 2.5e-12
_TOUCH_EXACT_SHARE = 2.5e-10
_PASSING = 1e-3
_GRIP_ROUNDS = 30
_GRIP_CHANGE = 1e-4
_GRIP_CHANGE_PASSING = 1e-2
# Of a push's time, until its force has a tangent to go by: a guess.
_TOUCHING_SHARE = 0.02
# Of a leg, where a gel relaxes: its stress is taken to change evenly in a step.
_EVEN_SHARE = 0.1


class Hold(StrEnum):
    """What stays as it is while the indenter is carried."""

    DEPTH = "depth"
    FORCE = "force"


@dataclass(slots=True, kw_only=True)
class PathCounts:
    """Work done along a path so far."""

    newton_iterations: int = 0
    increments: int = 0
    wall_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPoint:
    """An equilibrium on a path.

    Attributes:
        depth_m: Travel below first touch of the unloaded pad [m].
        force_n: Force on the indenter in the pad's frame [N], shape [3]; +z in compression.
        stiffness_n_m: dF_z / d(depth) by the tangent [N/m].
    """

    depth_m: float
    force_n: FloatArray
    stiffness_n_m: float
    state: State
    equilibrium: Equilibrium


@dataclass(slots=True)
class LoadingPath:
    """Moves one indenter against one pad.

    Args:
        model: The pad.
        indenter: The body.
        centre_m: Where its tip comes down, x and y [m].
        rotation: Indenter frame to pad frame from the start.
        step_max_m: Largest single advance [m]; 0 chooses an eightieth of the pad's height.
        potentials: Further energies of the nodes, such as weight.

    Attributes:
        unloaded: Nodes of the pad before it is touched [m]: undeformed, unless weight or the law's
            stress at rest deform it.
        history: (depth [m], F_z [N]) of every equilibrium on the way, those in passing within
            0.1 %.
    """

    model: Model
    indenter: Indenter
    centre_m: tuple[float, float] = (0.0, 0.0)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    step_max_m: float = 0.0
    options: NewtonOptions = field(default_factory=NewtonOptions)
    potentials: Sequence[NodalPotential] = ()
    counts: PathCounts = field(default_factory=PathCounts)
    solver: LinearSolver = field(init=False)
    unloaded: FloatArray = field(init=False)
    touch_m: float = field(init=False)
    setup_s: float = field(init=False)
    history: list[tuple[float, float]] = field(init=False, default_factory=list)
    _point: PathPoint | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        started = time.perf_counter()
        if self.step_max_m == 0.0:
            self.step_max_m = _STEP_SHARE * self.model.height_m
        self.solver = linear_solver(self.model.pattern)
        self.unloaded = unloaded_positions(
            self.model, self.solver, options=self.options, potentials=self.potentials
        )
        if self.model.relaxation is not None:
            self.model.relaxation.forget(self.unloaded)
        self.touch_m = self._touch_height()
        self.setup_s = time.perf_counter() - started

    @property
    def last(self) -> PathPoint | None:
        """The equilibrium that was reached last, also when a leg ended in an error."""
        return self._point

    def advance(
        self,
        depth_m: float,
        *,
        start: PathPoint | None = None,
        duration_s: float | None = None,
    ) -> PathPoint:
        """Press (or retract) to a depth.

        Args:
            start: Continue from here instead of from the last point.
            duration_s: Time that it takes [s], for a gel that relaxes; None is for ever.

        Raises:
            ConvergenceError: An increment failed even at the smallest step; the message names the
                last depth that was reached, ``last`` holds it.
        """
        point = start or self._point
        if point is None:
            point = self._first(depth_m, duration_s)
            duration_s = _part(1.0 - point.depth_m / depth_m, duration_s) if depth_m > 0.0 else None
        leg = DepthLeg(
            start=point.depth_m,
            end=depth_m,
            touch_m=self.touch_m,
            step_max_m=self.step_max_m,
            exact=_DEPTH_EXACT_SHARE * self.model.height_m,
        )
        foreign = start is not None and start is not self._point
        return self._travel(point, leg, foreign=foreign, duration_s=duration_s)

    def push(
        self,
        force_n: float,
        *,
        start: PathPoint | None = None,
        duration_s: float | None = None,
    ) -> PathPoint:
        """Press (or retract) until the indenter carries a force F_z [N]; its depth is found.

        Args:
            start: Continue from here instead of from the last point.
            duration_s: Time that it takes [s], for a gel that relaxes; None is for ever.

        Raises:
            ConvergenceError: As for ``advance``.
        """
        if not force_n > 0.0:
            return self.advance(0.0)
        point = start or self._point
        if point is None or not point.force_n[2] > 0.0:
            touching = self._touching_share(point, force_n, duration_s)
            depth = OVERLAP_SHARE * self.model.height_m
            point = self.advance(depth, duration_s=_part(touching, duration_s))
            duration_s = _part(1.0 - touching, duration_s)
        leg = ForceLeg(start=float(point.force_n[2]), end=force_n, step_max_m=self.step_max_m)
        foreign = start is not None and start is not self._point
        return self._travel(point, leg, foreign=foreign, duration_s=duration_s)

    def dwell(self, duration_s: float) -> PathPoint:
        """Let time pass at the same depth; a gel that relaxes pushes back less.

        Raises:
            ConvergenceError: As for ``advance``, or nothing was pressed yet.
        """
        point = self._pressed("dwells")
        self._begin(duration_s)
        point = self._settle(point.state.copy(), load_n=None, passing=False)
        self._accept(point)
        self._point = point
        return point

    def carry(
        self,
        *,
        shift_m: tuple[float, float] = (0.0, 0.0),
        twist_rad: float = 0.0,
        hold: Hold = Hold.DEPTH,
        duration_s: float | None = None,
    ) -> PathPoint:
        """Translate the pressed-in indenter and turn it about z through its tip.

        Args:
            duration_s: Time that it takes [s], for a gel that relaxes; None is for ever.

        Raises:
            ConvergenceError: As for ``advance``, or nothing was pressed yet.
        """
        point = self._pressed("is carried")
        leg = CarryLeg(
            origin=Pose(tip=point.state.tip, rotation=point.state.rotation),
            shift_m=np.array([*shift_m, 0.0]),
            twist_rad=twist_rad,
            load_n=float(point.force_n[2]) if hold is Hold.FORCE else None,
            step_max_m=self.step_max_m,
            radius_m=self._contact_radius(point),
        )
        return self._travel(point, leg, foreign=False, duration_s=duration_s)

    def body_force_n(self, point: PathPoint) -> FloatArray:
        """Return what weight and the like leave for clamp and indenter to carry [N], shape [3]."""
        free = ~self.model.clamped
        part = np.zeros(3)
        for potential in self.potentials:
            part += potential.gradient(point.state.positions)[free].sum(axis=0)
        return self.model.mesh.fold.whole_force(part)

    def _pressed(self, what: str) -> PathPoint:
        if self._point is None:
            raise ConvergenceError(
                f"the indenter {what} before it was pressed in", remedy="press it in first"
            )
        return self._point

    def _travel(
        self, point: PathPoint, leg: Leg, *, foreign: bool, duration_s: float | None
    ) -> PathPoint:
        started = time.perf_counter()
        if foreign and self.model.relaxation is not None:
            raise ConfigError(
                "a gel that relaxes cannot go back to an earlier point of its path",
                remedy="drive it by load or by depth, not by the displacement search",
            )
        point = self._refresh(point) if foreign else point
        whole = abs(leg.end - leg.start)
        pace = None if duration_s is None else duration_s / max(whole, 1e-300)
        even = whole * self._even_share(duration_s)
        at, step = leg.start, min(leg.longest(point.stiffness_n_m), even)
        while leg.is_short_of(at):
            advance = float(np.clip(leg.end - at, -step, step))
            try:
                point, taken = self._increment(point, leg, at, advance, pace)
            except ConvergenceError as error:
                step = abs(advance) / 4.0
                logger.debug("increment of %.3g failed: %s", advance, error.message)
                if step < leg.longest(point.stiffness_n_m) * _STEP_MIN_SHARE:
                    self._point = point
                    raise ConvergenceError(
                        f"the press stopped at {point.depth_m * 1e3:.4f} mm and "
                        f"{point.force_n[2]:.4f} N on the way to {leg.goal}: {error.message}",
                        remedy=error.remedy,
                    ) from error
                point = self._refresh(point)
                continue
            self._accept(point)
            at = leg.end if abs(leg.end - at - taken) <= leg.exact else at + taken
            step = min(leg.longest(point.stiffness_n_m), 2.0 * max(step, abs(taken)), even)
        self._point = point
        self.counts.wall_s += time.perf_counter() - started
        return point

    def _touch_height(self) -> float:
        """Return the tip height at which the unloaded pad is first felt [m]: a gap of d_hat.

        Counted from there, a press depends on d_hat ten times less than counted from gap zero: the
        gel then stays d_hat (1 - s) off, s near 1, instead of d_hat s.

        Raises:
            ConfigError: The indenter comes down beside the pad.
        """
        high = float(self.unloaded[:, 2].max())
        distance = self.model.contact_options.distance_m
        state = self.model.rest_state(tip=np.array([*self.centre_m, high]), rotation=self.rotation)
        for _ in range(100):
            gap = float(self.model.gaps(self.unloaded, self.indenter, state).min()) - distance
            if abs(gap) < _TOUCH_EXACT_SHARE * self.model.height_m:
                break
            state.tip[2] -= gap
            if state.tip[2] < 0.0:
                x, y = self.centre_m
                raise ConfigError(
                    f"the indenter at x = {x * 1e3:.4g} mm, y = {y * 1e3:.4g} mm comes down beside "
                    "the pad and never touches its top",
                    remedy="move it over the pad",
                )
        return float(state.tip[2])

    def _begin(self, duration_s: float | None) -> None:
        if self.model.relaxation is not None:
            self.model.relaxation.begin_step(math.inf if duration_s is None else duration_s)

    def _even_share(self, duration_s: float | None) -> float:
        """Return the part of a leg in which a relaxing gel's stress may be taken as a ramp."""
        remembers = self.model.relaxation is not None
        lasts = duration_s is not None and math.isfinite(duration_s)
        return _EVEN_SHARE if remembers and lasts else 1.0

    def _accept(self, point: PathPoint) -> None:
        """Remember a point that is gone on from."""
        self.history.append((point.depth_m, float(point.force_n[2])))
        if self.model.relaxation is not None:
            self.model.relaxation.commit(point.state.positions)

    def _first(self, depth_m: float, duration_s: float | None) -> PathPoint:
        depth = min(depth_m, OVERLAP_SHARE * self.model.height_m)
        self._begin(_part(depth / depth_m, duration_s) if depth_m > 0.0 else duration_s)
        point = self._settle(self._start(depth), load_n=None, passing=depth < depth_m)
        self._accept(point)
        return point

    def _start(self, depth_m: float) -> State:
        """Return the unloaded pad with the indenter at a depth."""
        tip = np.array([*self.centre_m, self.touch_m - depth_m])
        state = self.model.rest_state(tip=tip, rotation=self.rotation)
        state.positions = self.unloaded.copy()
        return state

    def _touching_share(
        self, point: PathPoint | None, force_n: float, duration_s: float | None
    ) -> float:
        """Return the part of a push in which the indenter comes to have a tangent to go by.

        Under a force that grows evenly that is what it carries by then; found in two tries.
        """
        share = _TOUCHING_SHARE
        if self.model.relaxation is None or duration_s is None or point is not None:
            return share
        for _ in range(2):
            self._begin(share * duration_s)
            start = self._start(OVERLAP_SHARE * self.model.height_m)
            carried = float(self._settle(start, load_n=None, passing=True).force_n[2])
            share = min(1.0, carried / force_n)
        return share

    def _contact_radius(self, point: PathPoint) -> float:
        """Return how far from the tip the gel is touched [m]."""
        contact = point.equilibrium.contact
        touched = np.any(contact.forces != 0.0, axis=2)
        away = contact.points[touched] - point.state.tip
        return float(np.hypot(away[:, 0], away[:, 1]).max()) if touched.any() else 0.0

    def _refresh(self, point: PathPoint) -> PathPoint:
        """Bring the solver's factor back to a point that was left."""
        self._problem(None).factorise_safely(point.state, point.equilibrium.contact)
        return point

    def _problem(self, load_n: float | None) -> Problem:
        copies = self.model.mesh.fold.copies
        return Problem(
            self.model,
            self.solver,
            self.indenter,
            load_n=None if load_n is None else load_n / copies,
            potentials=self.potentials,
        )

    def _settle(self, state: State, *, load_n: float | None, passing: bool) -> PathPoint:
        """Find the equilibrium, friction's lagged pressure included."""
        options = replace(self.options, residual_relative=_PASSING) if passing else self.options
        problem = self._problem(load_n)
        allowed = _GRIP_CHANGE_PASSING if passing else _GRIP_CHANGE
        for _ in range(_GRIP_ROUNDS):
            found = equilibrate(problem, state, options=options)
            self.counts.newton_iterations += found.iterations
            if self.model.refresh_grip(self.indenter, state) <= allowed:
                break
        else:
            raise ConvergenceError(
                f"friction did not settle in {_GRIP_ROUNDS} rounds",
                remedy="move in smaller steps, or with less friction",
            )
        self.model.drag_anchors(self.indenter, state)
        # The last step's factor is one step old, and the barrier's stiffness has changed since.
        problem.factorise_safely(state, found.contact)
        self.counts.increments += 1
        force = self.model.mesh.fold.whole_force(found.contact.forces.reshape(-1, 3).sum(axis=0))
        _, stiffness = self._response(state, found, DOWN, STILL)
        return PathPoint(
            depth_m=self.touch_m - float(state.tip[2]),
            force_n=force,
            stiffness_n_m=stiffness,
            state=state,
            equilibrium=found,
        )

    def _response(
        self, state: State, found: Equilibrium, velocity: FloatArray, spin: FloatArray
    ) -> tuple[FloatArray, float]:
        """Return the tangent's answer to a motion of the indenter.

        Args:
            velocity: Of the tip [m/unit], shape [3].
            spin: About the tip [rad/unit], shape [3].

        Returns:
            Motion of the nodes [m/unit], shape [node_count, 3], and of F_z [N/unit].
        """
        contact, pattern = found.contact, self.model.pattern
        carried = velocity + np.cross(spin, contact.points - state.tip)
        change = np.cross(spin, contact.forces)
        change -= np.einsum("fpij,fpj->fpi", contact.stiffness, carried)
        motion = -pattern.nodal(self.solver.solve(pattern.unknowns(self.model.scatter(change))))
        lifted = float(np.sum(self.model.scatter(contact.stiffness[..., 2]) * motion))
        rate = self.model.mesh.fold.copies * (float(change[..., 2].sum()) + lifted)
        return motion, rate

    def _increment(
        self, point: PathPoint, leg: Leg, at: float, advance: float, pace: float | None
    ) -> tuple[PathPoint, float]:
        """Go one step; return where that led and how much of the leg was done."""
        found, state = point.equilibrium, point.state.copy()
        velocity, spin = leg.rate(point.stiffness_n_m)
        motion, lift = self._response(point.state, found, velocity, spin)
        if leg.holds_force:
            sink = -lift / max(point.stiffness_n_m, 1e-30)
            motion = motion + sink * self._response(point.state, found, DOWN, STILL)[0]
            velocity = velocity + sink * DOWN
        turned = leg.turned(state.rotation, advance)
        tip = state.tip + advance * velocity
        state.rotation = turned
        fraction = overlap_fraction(self.model, self.indenter, state, tip, advance * motion)
        if np.any(spin) and fraction < 1.0:
            raise ConvergenceError("the next turn would overlap the indenter")
        if fraction * abs(advance) < leg.longest(point.stiffness_n_m) * 1e-6:
            raise ConvergenceError("the next step would overlap the indenter")
        state.positions = state.positions + fraction * advance * motion
        state.tip = state.tip + fraction * (tip - state.tip)
        reached = at + fraction * advance
        self._begin(None if pace is None else pace * fraction * abs(advance))
        passing = leg.is_short_of(reached)
        settled = self._settle(state, load_n=leg.load_at(reached), passing=passing)
        return settled, fraction * advance


def _part(share: float, duration_s: float | None) -> float | None:
    """Return a part of a time; for ever stays for ever."""
    return duration_s if duration_s in (None, math.inf) else share * duration_s


DOWN = np.array([0.0, 0.0, -1.0])
STILL = np.zeros(3)
