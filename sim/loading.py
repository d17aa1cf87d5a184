"""A loading path: the indenter moved in steps, each started from the tangent's prediction."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field, replace

import numpy as np

from sim.arrays import FloatArray
from sim.indenter import Indenter
from sim.linear_solver import LinearSolver, linear_solver
from sim.model import Model
from sim.newton import OVERLAP_MAX_M, Equilibrium, NewtonOptions, equilibrate, overlap_fraction
from sim.state import State
from tacauchy_rig.errors import ConvergenceError

logger = logging.getLogger(__name__)

_STEP_MIN_M = 1e-9
_DEPTH_EXACT_M = 1e-14
_PASSING = 1e-3


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
        depth_m: Travel below first touch of the undeformed pad [m].
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
    """Presses one indenter into one pad along -z.

    Args:
        model: The pad.
        indenter: The body.
        centre_m: Where its tip stands, x and y [m].
        step_max_m: Largest single advance [m].
    """

    model: Model
    indenter: Indenter
    centre_m: tuple[float, float] = (0.0, 0.0)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    step_max_m: float = 0.05e-3
    options: NewtonOptions = field(default_factory=NewtonOptions)
    counts: PathCounts = field(default_factory=PathCounts)
    solver: LinearSolver = field(init=False)
    touch_m: float = field(init=False)
    setup_s: float = field(init=False)
    _point: PathPoint | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        started = time.perf_counter()
        self.solver = linear_solver(self.model.pattern)
        self.touch_m = self._touch_height()
        self.setup_s = time.perf_counter() - started

    @property
    def last(self) -> PathPoint | None:
        """The equilibrium that was reached last."""
        return self._point

    def advance(self, depth_m: float, *, start: PathPoint | None = None) -> PathPoint:
        """Press (or retract) to a depth.

        Args:
            start: Continue from here instead of from the last point.

        Raises:
            ConvergenceError: An increment failed even at the smallest step; the message names the
                last depth that was reached.
        """
        started = time.perf_counter()
        point = start or self._point or self._first(depth_m)
        if start is not None and start is not self._point:
            point = self._refresh(start)
        step = self.step_max_m
        while abs(depth_m - point.depth_m) > _DEPTH_EXACT_M:
            advance = float(np.clip(depth_m - point.depth_m, -step, step))
            try:
                reached = self._increment(point, advance, depth_m)
            except ConvergenceError as error:
                step = abs(advance) / 4.0
                logger.debug("increment of %.3g um failed: %s", advance * 1e6, error.message)
                if step < _STEP_MIN_M:
                    raise ConvergenceError(
                        f"the press stopped at {point.depth_m * 1e3:.4f} mm and "
                        f"{point.force_n[2]:.4f} N on the way to {depth_m * 1e3:.4f} mm: "
                        f"{error.message}",
                        remedy=error.remedy,
                    ) from error
                point = self._refresh(point)
                continue
            step = min(self.step_max_m, 2.0 * max(step, abs(reached.depth_m - point.depth_m)))
            point = reached
        self._point = point
        self.counts.wall_s += time.perf_counter() - started
        return point

    def _touch_height(self) -> float:
        """Return the tip height at which the undeformed pad is touched [m]."""
        high = float(self.model.nodes[:, 2].max())
        state = self.model.rest_state(tip=np.array([*self.centre_m, high]), rotation=self.rotation)
        for _ in range(100):
            gap = float(self.model.gaps(self.model.nodes, self.indenter, state).min())
            if abs(gap) < 1e-12:
                break
            state.tip[2] -= gap
        return float(state.tip[2])

    def _first(self, depth_m: float) -> PathPoint:
        depth = min(depth_m, OVERLAP_MAX_M)
        state = self._state_at(depth)
        return self._settle(state, depth, passing=depth < depth_m)

    def _state_at(self, depth_m: float) -> State:
        tip = np.array([*self.centre_m, self.touch_m - depth_m])
        return self.model.rest_state(tip=tip, rotation=self.rotation)

    def _refresh(self, point: PathPoint) -> PathPoint:
        """Bring the solver's factor back to a point that was left."""
        self._factorise(point)
        return point

    def _factorise(self, point: PathPoint) -> None:
        stiffness = point.equilibrium.contact.stiffness
        data = self.model.hessian_data(point.state.positions, stiffness, projected=False)
        self.solver.factorise(data)

    def _settle(self, state: State, depth_m: float, *, passing: bool) -> PathPoint:
        self.model.update_anchors(self.indenter, state)
        options = replace(self.options, residual_relative=_PASSING) if passing else self.options
        found = equilibrate(self.model, self.solver, self.indenter, state, options=options)
        if found.iterations == 0:
            data = self.model.hessian_data(
                state.positions, found.contact.stiffness, projected=False
            )
            self.solver.factorise(data)
        self.counts.newton_iterations += found.iterations
        self.counts.increments += 1
        force = self.model.mesh.fold.whole_force(found.contact.forces.reshape(-1, 3).sum(axis=0))
        _, stiffness = self._response(found)
        return PathPoint(
            depth_m=depth_m,
            force_n=force,
            stiffness_n_m=stiffness,
            state=state,
            equilibrium=found,
        )

    def _response(self, found: Equilibrium) -> tuple[FloatArray, float]:
        """Return dx/d(depth), shape [node_count, 3], and dF_z/d(depth) [N/m]."""
        pulled = -found.contact.stiffness[..., 2]
        nodal = self.model.scatter(pulled)
        pattern = self.model.pattern
        motion = pattern.nodal(self.solver.solve(pattern.unknowns(nodal)))
        part = float(-pulled[..., 2].sum() - np.sum(nodal * motion))
        stiffness = self.model.mesh.fold.copies * part
        return motion, stiffness

    def _increment(self, point: PathPoint, advance_m: float, target_m: float) -> PathPoint:
        motion, _ = self._response(point.equilibrium)
        state = point.state.copy()
        tip = state.tip - np.array([0.0, 0.0, advance_m])
        fraction = overlap_fraction(self.model, self.indenter, state, tip, advance_m * motion)
        state.positions = state.positions + fraction * advance_m * motion
        state.tip = state.tip + fraction * (tip - state.tip)
        if fraction * abs(advance_m) < _STEP_MIN_M:
            raise ConvergenceError(f"the next {advance_m * 1e6:.3g} um would overlap the indenter")
        reached = point.depth_m + fraction * advance_m
        return self._settle(state, reached, passing=abs(target_m - reached) > _DEPTH_EXACT_M)
