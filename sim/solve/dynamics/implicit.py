"""A press in time: the gel has mass, and the indenter follows a given depth.

Every step is implicit Euler's: an equilibrium with inertia as one more energy. Within a step the
indenter is brought to its new depth in as many goes as contact asks for; they take no time.

Where the stored energy is convex in nodes and indenter together, stored plus kinetic energy grows
in a step by no more than the force at its end times the indenter's travel: the equation of motion
at the step's end, times the step's motion, says so. That work is what is summed here, so that a
fall of ``DynamicStep.damped_j`` would show energy out of nothing.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.contact.state import State
from sim.scene.scene import Scene
from sim.solve.dynamics.weight_and_inertia import INERTIA, inertia, nodal_masses
from sim.solve.equilibrium import Equilibrium
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.path import LoadingPath
from sim.solve.overlap import overlap_fraction
from tacauchy_rig.errors import ConfigError, ConvergenceError

logger = logging.getLogger(__name__)

# Residual over the contact force that will do within a time step.
_PASSING = 1e-3
# Shortest way that the indenter is brought at once, and distance from its goal that is none.
_GO_MIN_M, _DEPTH_EXACT_M = 1e-9, 1e-14
# Time steps of a press that is too quick for statics.
STEP_COUNT = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicStep:
    """The end of a time step; forces and energies are the whole pad's.

    Attributes:
        depth_m: Travel below first touch of the unloaded pad [m].
        force_n: Force on the indenter in the pad's frame [N], shape [3]; +z in compression.
        elastic_j: Stored in the gel [J]; with relaxation the step's incremental energy instead.
        contact_j: Stored in the barrier [J].
        potential_j: Of weight and the like [J].
        work_j: Done by the indenter since the start [J].
        damped_j: Work that is in no energy [J]: lost in implicit Euler's damping.
        newton_iterations: Factorisations spent on this step's equilibria.
    """

    time_s: float
    depth_m: float
    force_n: FloatArray
    elastic_j: float
    kinetic_j: float
    contact_j: float
    potential_j: float
    work_j: float
    damped_j: float
    gap_min_m: float
    min_jacobian: float
    newton_iterations: int


class DynamicPress:
    """Steps a pad and its indenter through time, from a path's last equilibrium or from rest.

    Args:
        path: Gives pad, indenter, place, weight and where the depth counts from; what it reached
            last is where the motion begins.
        density_kg_m3: One number, or one for each tetrahedron.
        depth_m: Depth of the indenter at the start, for a path that has not begun; negative is
            above the pad.

    Raises:
        ConfigError: The contact is bonded or has friction, or the indenter starts in the pad.
    """

    def __init__(
        self, path: LoadingPath, *, density_kg_m3: float | FloatArray, depth_m: float = 0.0
    ) -> None:
        if path.model.contact_options.is_tangential:
            raise ConfigError(
                "a press with inertia has frictionless contact only",
                remedy="leave friction or inertia out",
            )
        if path.last is None and depth_m > 0.0:
            raise ConfigError(
                f"the indenter starts {depth_m * 1e3:g} mm inside the pad",
                remedy="start at a depth of 0 mm or less",
            )
        self._path, self._model = path, path.model
        self._masses = nodal_masses(path.model, density_kg_m3, INERTIA)
        self._copies = path.model.mesh.symmetry.copies
        self.state = path.untouched(depth_m) if path.last is None else path.last.state.copy()
        if path.last is None and path.model.relaxation is not None:
            path.model.relaxation.forget(self.state.positions)
        self.velocities = np.zeros_like(self.state.positions)
        self._time_s, self._work_j = 0.0, 0.0
        self._energy_j = sum(self._energies(self.state))

    @property
    def depth_m(self) -> float:
        """Where the indenter is now [m]."""
        return self._path.touch_m - float(self.state.tip[2])

    def run(
        self, depth_at: Callable[[float], float], *, step_s: float, duration_s: float
    ) -> list[DynamicStep]:
        """Follow a depth [m] over time [s] in even steps.

        Raises:
            ConvergenceError: A step has no solution; the message names its time.
        """
        count = max(1, round(duration_s / step_s))
        began = self._time_s
        return [self.step(depth_at(began + (k + 1) * step_s), step_s) for k in range(count)]

    def step(self, depth_m: float, step_s: float) -> DynamicStep:
        """Bring the indenter to a depth [m] in one time step [s].

        Raises:
            ConvergenceError: The step has no solution; state and time are those before it.
        """
        flown = self.state.positions + step_s * self.velocities
        flown[self._model.clamped] = self._model.nodes[self._model.clamped]
        flight = inertia(self._masses, flown_m=flown, step_s=step_s)
        self._path.solver.replace_potentials((*self._path.potentials, flight))
        if self._model.relaxation is not None:
            self._model.relaxation.begin_step(step_s)
        try:
            state, found, iterations = self._travel(depth_m)
        except ConvergenceError as error:
            raise ConvergenceError(
                f"time step of {step_s:.3g} s from {self._time_s:.6g} s to a depth of "
                f"{depth_m * 1e3:.4f} mm: {error.message}",
                remedy="take smaller time steps or a slower indenter",
            ) from error
        return self._accept(state, found, iterations, step_s)

    def _travel(self, depth_m: float) -> tuple[State, Equilibrium, int]:
        """Bring the indenter down within one time step."""
        target = self._path.touch_m - depth_m
        state, longest, iterations = self.state.copy(), self._path.step_max_m, 0
        while True:
            trial = state.copy()
            left = target - float(state.tip[2])
            self._predict(trial, float(np.clip(left, -longest, longest)))
            ended = abs(target - trial.tip[2]) <= _DEPTH_EXACT_M
            options = self._path.options
            if not ended:
                options = replace(options, residual_relative=_PASSING)
            try:
                found = self._path.solver.settle(trial, options=options)
            except ConvergenceError as error:
                longest = 0.25 * abs(float(trial.tip[2] - state.tip[2]))
                logger.debug("a go failed: %s", error.message)
                if longest < _GO_MIN_M:
                    raise
                continue
            state, iterations = trial, iterations + found.iterations
            if ended:
                return state, found, iterations
            longest = min(self._path.step_max_m, 2.0 * longest)

    def _predict(self, state: State, rise_m: float) -> None:
        """Move indenter and nodes by the tangent, as far as overlap allows."""
        model, solver = self._model, self._path.solver
        pattern, indenter = model.pattern, self._path.indenter
        solver.take_factor(state)
        contact = model.surface.forces(state.positions, indenter, state)
        rise = np.array([0.0, 0.0, rise_m])
        pulled = pattern.unknowns(model.surface.scatter(contact.stiffness @ rise))
        unbalanced = pattern.unknowns(solver.evaluate(state).gradient)
        motion = pattern.nodal(solver.factor.solve(pulled - unbalanced))
        tip = state.tip + rise
        fraction = overlap_fraction(self._model, indenter, state, tip, motion)
        state.positions = state.positions + fraction * motion
        state.tip = state.tip + fraction * rise

    def _accept(
        self, state: State, found: Equilibrium, iterations: int, step_s: float
    ) -> DynamicStep:
        symmetry, model = self._model.mesh.symmetry, self._model
        force = symmetry.whole_force(found.push_n)
        self._work_j -= float(force @ (state.tip - self.state.tip))
        self.velocities = (state.positions - self.state.positions) / step_s
        self.state, self.equilibrium = state, found
        self._time_s += step_s
        if model.relaxation is not None:
            model.relaxation.commit(state.positions)
        elastic, contact, potential = self._energies(state)
        squares = np.sum(self.velocities**2, axis=1)
        kinetic = 0.5 * self._copies * float(self._masses @ squares)
        total = elastic + contact + potential + kinetic
        return DynamicStep(
            time_s=self._time_s,
            depth_m=self.depth_m,
            force_n=force,
            elastic_j=elastic,
            kinetic_j=kinetic,
            contact_j=contact,
            potential_j=potential,
            work_j=self._work_j,
            damped_j=self._work_j - (total - self._energy_j),
            gap_min_m=float(model.surface.gaps(state.positions, self._path.indenter, state).min()),
            min_jacobian=found.min_jacobian,
            newton_iterations=iterations,
        )

    def _energies(self, state: State) -> tuple[float, float, float]:
        """Return what is stored in gel, barrier and weight, of the whole pad [J]."""
        elastic, _ = self._model.gel.energy(state.positions)
        contact = self._model.surface.energy(state.positions, self._path.indenter, state)
        potential = sum(each.energy(state.positions) for each in self._path.potentials)
        return self._copies * elastic, self._copies * contact, self._copies * potential


def moving_press(
    scene: Scene, path: LoadingPath, *, density_kg_m3: float | FloatArray
) -> PathPoint:
    """Press to a depth in the scene's time and return the last instant.

    Clamp and indenter do not balance: what is missing accelerates the gel.

    Raises:
        ConfigError: The scene asks for a force, for friction or for a motion besides.
        ConvergenceError: A time step has no solution.
    """
    depth = scene.target.depth_m
    if depth is None or not scene.motion.is_straight:
        raise ConfigError(
            f"a press of {scene.duration_s:g} s calls for inertia, which goes straight down to a "
            "depth only",
            remedy="give a depth, or switch it off with --effect inertia=off",
        )
    started = time.perf_counter()
    pressing = DynamicPress(path, density_kg_m3=density_kg_m3)
    steps = pressing.run(
        lambda time_s: depth * min(1.0, time_s / scene.duration_s),
        step_s=scene.duration_s / STEP_COUNT,
        duration_s=scene.duration_s,
    )
    path.counts.newton_iterations += sum(step.newton_iterations for step in steps)
    path.counts.wall_s += time.perf_counter() - started
    return PathPoint(
        depth_m=steps[-1].depth_m,
        force_n=steps[-1].force_n,
        stiffness_n_m=float("nan"),
        state=pressing.state,
        equilibrium=pressing.equilibrium,
    )
