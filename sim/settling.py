"""One pose of the indenter settled: equilibrium, friction's lagged pressure, and the tangent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.indenter import Indenter
from sim.linear_solver import LinearSolver
from sim.model import Model
from sim.newton import Equilibrium, NewtonOptions, equilibrate
from sim.path_point import PathPoint
from sim.potentials import NodalPotential
from sim.problem import Problem
from sim.state import State
from tacauchy_rig.errors import ConvergenceError

DOWN = np.array([0.0, 0.0, -1.0])
STILL = np.zeros(3)
_PASSING = 1e-3
_GRIP_ROUNDS = 30
_GRIP_CHANGE = 1e-4
_GRIP_CHANGE_PASSING = 1e-2


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
    """

    model: Model
    solver: LinearSolver
    indenter: Indenter
    potentials: Sequence[NodalPotential]
    touch_m: float
    counts: PathCounts

    def settle(
        self, state: State, *, load_n: float | None, passing: bool, options: NewtonOptions
    ) -> PathPoint:
        """Find the equilibrium, friction's lagged pressure included.

        Args:
            state: Where to start from; it becomes the point's.
            load_n: Force that the indenter is pushed with [N]; None holds it where it is.
            passing: To 0.1 % will do.

        Raises:
            ConvergenceError: There is none, or friction does not come to rest.
        """
        options = replace(options, residual_relative=_PASSING) if passing else options
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
        _, stiffness = self.response(state, found, DOWN, STILL)
        return PathPoint(
            depth_m=self.touch_m - float(state.tip[2]),
            force_n=force,
            stiffness_n_m=stiffness,
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
        motion = -pattern.nodal(self.solver.solve(pattern.unknowns(self.model.scatter(change))))
        lifted = float(np.sum(self.model.scatter(contact.stiffness[..., 2]) * motion))
        rate = self.model.mesh.fold.copies * (float(change[..., 2].sum()) + lifted)
        return motion, rate

    def _problem(self, load_n: float | None) -> Problem:
        copies = self.model.mesh.fold.copies
        return Problem(
            self.model,
            self.solver,
            self.indenter,
            load_n=None if load_n is None else load_n / copies,
            potentials=self.potentials,
        )
