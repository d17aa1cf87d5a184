"""One pose of the indenter settled, and the response of its stiffness to a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.contact.state import State
from sim.solve.equilibrium import Equilibrium, EquilibriumSolver, SolverOptions
from tacauchy_rig.core.arrays import FloatArray

# Residual over the contact force that will do on the way to another point, which is extrapolated
# from points in passing and the better the closer they are.
_PASSING = 1e-4
# Of F_z: what it changes by less tells no stiffness; in passing it is met to a tenth of that.
_TELLS_STIFFNESS = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPoint:
    """An equilibrium on a path.

    Attributes:
        depth_m: Travel below first touch of the unloaded pad [m].
        force_n: Force on the indenter in the pad's frame [N], shape [3]; +z in compression.
        stiffness_n_m: dF_z / d(depth) since the point before [N/m]; that point's where it was not
            pressed deeper: what slides under a load sinks without a force.
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
        touch_m: Tip height from which depth counts [m].
    """

    solver: EquilibriumSolver
    touch_m: float
    counts: PathCounts

    def settle(
        self,
        state: State,
        *,
        load_n: float | None,
        passing: bool,
        options: SolverOptions,
        before: PathPoint | None = None,
    ) -> PathPoint:
        """Find the equilibrium, friction's lagged pressure included.

        Args:
            state: Where to start from; it becomes the point's.
            load_n: Force that the indenter is pushed with [N]; None holds it where it is.
            passing: To 0.01 % will do.
            before: The point that was gone on from.

        Raises:
            ConvergenceError: There is none.
        """
        model, wanted = self.solver.model, options.residual_relative
        if load_n is not None:
            load_n = load_n / model.mesh.symmetry.copies
            wanted = min(wanted, options.load_relative)
        options = replace(options, residual_relative=_PASSING if passing else wanted)
        found = self.solver.settle(state, load_n=load_n, options=options)
        if model.contact_options.bonded:
            model.surface.refresh_grip(self.solver.indenter, state)
        model.surface.drag_anchors(self.solver.indenter, state)
        self.counts.newton_iterations += found.iterations
        self.counts.increments += 1
        return self._point(state, found, before)

    def _point(self, state: State, found: Equilibrium, before: PathPoint | None) -> PathPoint:
        force, depth = (
            self.solver.model.mesh.symmetry.whole_force(found.push_n),
            self.touch_m - float(state.tip[2]),
        )
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

    def response(
        self, state: State, found: Equilibrium, velocity: FloatArray, spin: FloatArray
    ) -> tuple[FloatArray, float]:
        """Return the answer to a motion of the indenter, by the stiffness that was factored last.

        Args:
            velocity: Of the tip [m/unit], shape [3].
            spin: About the tip [rad/unit], shape [3].

        Returns:
            Motion of the nodes [m/unit], shape [node_count, 3], and of F_z [N/unit].
        """
        model, contact = self.solver.model, found.contact
        carried = velocity + np.cross(spin, contact.points - state.tip)
        change = np.cross(spin, contact.forces)
        change -= np.einsum("fpij,fpj->fpi", contact.stiffness, carried)
        pulled = model.pattern.unknowns(model.surface.scatter(change))
        motion = -model.pattern.nodal(self.solver.factor.solve(pulled))
        lifted = float(np.sum(model.surface.scatter(contact.stiffness[..., 2]) * motion))
        rate = model.mesh.symmetry.copies * (float(change[..., 2].sum()) + lifted)
        return motion, rate
