"""One pose of the indenter settled: equilibrium, friction's lagged pressure, and the tangent."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.contact.state import State
from sim.scene.indenter import Indenter
from sim.solve.linear_solver import LinearSolver
from sim.solve.load_steps.phases import DOWN, STILL
from sim.solve.model import Model
from sim.solve.newton import Equilibrium, NewtonOptions, equilibrate
from sim.solve.preconditioned_lbfgs import PreconditionedLbfgs
from sim.solve.problem import NodalPotential, Problem
from tacauchy_rig.errors import ConvergenceError

logger = logging.getLogger(__name__)
# Residual over the contact force that will do on the way to another point.
_PASSING = 1e-3
# The next start is extrapolated from points in passing, and the better the closer they are.
_PASSING_EXTRAPOLATED = 1e-4
# A load that is asked for is met as closely as by Newton's method.
_LOAD_MET = 1e-8
# Friction's pressure is lagged: Newton is run again until the limit changes by no more than this.
_GRIP_ROUNDS = 30
_GRIP_CHANGE = 1e-4
_GRIP_CHANGE_PASSING = 1e-2


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

    @property
    def contact_radius_m(self) -> float:
        """How far from the tip the gel is touched [m]."""
        contact = self.equilibrium.contact
        touched = np.any(contact.forces != 0.0, axis=2)
        away = contact.points[touched] - self.state.tip
        return float(np.hypot(away[:, 0], away[:, 1]).max()) if touched.any() else 0.0


@dataclass(slots=True, kw_only=True)
class PathCounts:
    """Work done along a path so far."""

    newton_iterations: int = 0
    increments: int = 0
    wall_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """Settles one indenter against one pad.

    Attributes:
        solver: Holds the factor of the equilibrium that was settled or refreshed last.
        touch_m: Tip height from which depth counts [m].
        lbfgs: Tried first where it is given.
    """

    model: Model
    solver: LinearSolver
    indenter: Indenter
    potentials: Sequence[NodalPotential]
    touch_m: float
    counts: PathCounts
    lbfgs: PreconditionedLbfgs | None = None

    def settle(
        self,
        state: State,
        *,
        load_n: float | None,
        passing: bool,
        options: NewtonOptions,
        before: PathPoint | None = None,
    ) -> PathPoint:
        """Find the equilibrium, friction's lagged pressure included.

        Args:
            state: Where to start from; it becomes the point's.
            load_n: Force that the indenter is pushed with [N]; None holds it where it is.
            passing: To 0.1 % will do.
            before: The point that was gone on from.

        Raises:
            ConvergenceError: There is none, or friction does not come to rest.
        """
        found_by_lbfgs = self._settled_by_lbfgs(state, load_n, passing, options, before)
        if found_by_lbfgs is not None:
            return found_by_lbfgs
        options = replace(options, residual_relative=_PASSING) if passing else options
        problem = self._problem(load_n)
        allowed = _GRIP_CHANGE_PASSING if passing else _GRIP_CHANGE
        for _ in range(_GRIP_ROUNDS):
            found = equilibrate(problem, state, options=options)
            self.counts.newton_iterations += found.iterations
            if self.model.surface.refresh_grip(self.indenter, state) <= allowed:
                break
        else:
            raise ConvergenceError(
                f"friction did not settle in {_GRIP_ROUNDS} rounds",
                remedy="move in smaller steps, or with less friction",
            )
        self.model.surface.drag_anchors(self.indenter, state)
        # The last step's factor is one step old, and the barrier's stiffness has changed since.
        problem.factorise_safely(state, found.contact)
        self.counts.increments += 1
        _, stiffness = self.response(state, found, DOWN, STILL)
        return self._point(state, found, stiffness)

    def _settled_by_lbfgs(
        self,
        state: State,
        load_n: float | None,
        passing: bool,
        options: NewtonOptions,
        before: PathPoint | None,
    ) -> PathPoint | None:
        """Return the point that L-BFGS finds, with the last step's stiffness; None for none."""
        if self.lbfgs is None:
            return None
        trial, wanted = state.copy(), options.residual_relative
        if load_n is not None:
            load_n, wanted = load_n / self.model.mesh.symmetry.copies, min(wanted, _LOAD_MET)
        relative = _PASSING_EXTRAPOLATED if passing else wanted
        found = self.lbfgs.settle(trial, load_n=load_n, residual_relative=relative)
        if found is None:
            logger.debug("no equilibrium with a kept factor at %.4g m", trial.tip[2])
            return None
        self.counts.newton_iterations += found.iterations
        self.counts.increments += 1
        point = self._point(trial, found, float("nan"))
        force, depth = float(point.force_n[2]), point.depth_m
        if before is not None and before.depth_m != depth:
            force, depth = force - float(before.force_n[2]), depth - before.depth_m
        return replace(point, stiffness_n_m=force / depth if depth else 0.0)

    def _point(self, state: State, found: Equilibrium, stiffness_n_m: float) -> PathPoint:
        pushed = found.contact.forces.reshape(-1, 3).sum(axis=0)
        return PathPoint(
            depth_m=self.touch_m - float(state.tip[2]),
            force_n=self.model.mesh.symmetry.whole_force(pushed),
            stiffness_n_m=stiffness_n_m,
            state=state,
            equilibrium=found,
        )

    def refresh(self, point: PathPoint) -> PathPoint:
        """Bring the solver's factor back to a point that was left."""
        self._problem(None).factorise_safely(point.state, point.equilibrium.contact)
        return point

    def response(
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
        motion = -pattern.nodal(
            self.solver.solve(pattern.unknowns(self.model.surface.scatter(change)))
        )
        lifted = float(np.sum(self.model.surface.scatter(contact.stiffness[..., 2]) * motion))
        rate = self.model.mesh.symmetry.copies * (float(change[..., 2].sum()) + lifted)
        return motion, rate

    def _problem(self, load_n: float | None) -> Problem:
        copies = self.model.mesh.symmetry.copies
        return Problem(
            self.model,
            self.solver,
            self.indenter,
            load_n=None if load_n is None else load_n / copies,
            potentials=self.potentials,
        )
