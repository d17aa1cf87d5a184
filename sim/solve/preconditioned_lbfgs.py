"""Equilibria of a press along one path at few factorisations: the factor of an earlier one is kept.

Newton's direction takes the inverse of a stiffness that an earlier state had, corrected by what the
last steps have shown of the present one (``LimitedMemory``). A step then costs one evaluation of
the forces and one solution, a twentieth of a factorisation. The stiffness is factored anew where
the last state took many steps, or this one does. Each state starts where the last three point to.
Without friction an equilibrium depends on the indenter's height alone, so that any three near it
will do.

Where this does not come to rest it says so, and Newton's method proper takes over.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp
from scipy.linalg.blas import daxpy

from sim.arrays import FloatArray
from sim.contact.indenter_distance import body_at
from sim.contact.state import State
from sim.device import Device
from sim.scene.indenter import Indenter
from sim.solve.linear_solver import LinearSolver, NotPositiveDefiniteError, single_precision_solver
from sim.solve.model import Model
from sim.solve.newton import Equilibrium
from sim.solve.problem import NodalPotential

# Steps with less curvature are not learnt from: s . y over |s| |y|, which rounding would decide.
_CURVATURE_MIN = 1e-12
# Before Newton's method takes over: steps and factors of a state, lengths tried of a step.
_STEPS_MAX, _FACTORS_MAX, _TRIES = 120, 10, 10
# Evaluations of the state before the first, which thus begins with a factor.
_NEVER = 1_000_000
# Share of the slope that a step may end with (Wolfe's second condition; Nocedal and Wright, 3.1),
# and the least that a step is shortened to at once.
_SLOPE_LEFT, _SHORTEST = 0.9, 0.1
# A residual that is always enough, over E H^2, and a stiffness that is none, over E H, with the
# pad's height H.
_FLOOR_SHARE, _HELD = 1e-11, 1e-13


class NodalForces:
    """Forces of a gel and of contact without friction, in arrays that are kept.

    Args:
        model: The pad, on the CPU.
        indenter: The body, analytic.
        extension: Share of d_hat below which the barrier is a parabola.

    Attributes:
        elastic: Gradient of the elastic energy [N], shape [node_count, 3]; like the others of the
            state that was evaluated last.
        push: Force on the indenter, modelled part [N], shape [3].
        gap: Smallest gap of a point that touches [m], shape [1].
    """

    def __init__(self, model: Model, indenter: Indenter, *, extension: float) -> None:
        self._indenter = indenter
        self._pose: tuple[float, ...] = ()
        cpu, count = Device("cpu"), len(model.nodes)
        positions, elastic, contact = (cpu.zeros(count, wp.vec3d) for _ in range(3))
        push, gap = cpu.zeros(1, wp.vec3d), cpu.zeros(1, wp.float64)
        self._at, self.elastic, self._contact = (a.numpy() for a in (positions, elastic, contact))
        self.push, self.gap = push.numpy()[0], gap.numpy()
        self._ratios, self._find_ratios = model.gel.recorded_ratios(positions)
        self._launches = (
            model.gel.recorded_gradient(positions, elastic),
            model.surface.recorded_push(
                positions, [contact, push, gap], indenter, extension=extension
            ),
        )

    def gradient(self, state: State) -> FloatArray:
        """Return the gradient of the energy by the nodes [N], shape [node_count, 3]."""
        self._at[:] = state.positions
        for array in (self.elastic, self._contact, self.push):
            array.fill(0.0)
        self.gap.fill(np.inf)
        gel, contact = self._launches
        pose = (*state.tip.tolist(), *state.rotation.reshape(-1).tolist())
        if pose != self._pose:
            contact.set_param_by_name("body", body_at(self._indenter, state.tip, state.rotation))
            self._pose = pose
        gel.launch()
        contact.launch()
        return np.asarray(self.elastic + self._contact)

    def smallest_ratio(self) -> float:
        """Return the smallest volume ratio of the state that was evaluated last."""
        self._find_ratios.launch()
        return float(self._ratios.min())


class LimitedMemory:
    """What the last steps have shown of a Hessian, added to an inverse that is about right.

    Args:
        length: Steps that are remembered.
    """

    def __init__(self, length: int) -> None:
        self._pairs: deque[tuple[FloatArray, FloatArray, float]] = deque(maxlen=length)

    def forget(self) -> None:
        """Begin anew, since another inverse takes over."""
        self._pairs.clear()

    def learn(self, step: FloatArray, change: FloatArray) -> None:
        """Remember how a step changed the gradient, unless it went along no curvature."""
        curvature = float(step @ change)
        if curvature > _CURVATURE_MIN * np.linalg.norm(step) * np.linalg.norm(change):
            self._pairs.append((step, change, 1.0 / curvature))

    def direction(
        self, gradient: FloatArray, inverse: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Return minus the inverse Hessian times a gradient.

        Args:
            inverse: Applies the inverse that is about right.
        """
        left = -gradient
        shares = []
        for step, change, scale in reversed(self._pairs):
            shares.append(scale * float(step @ left))
            left = daxpy(change, left, a=-shares[-1])
        found = inverse(left)
        for step, change, scale in self._pairs:
            found = daxpy(step, found, a=shares.pop() - scale * float(change @ found))
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class LbfgsOptions:
    """When a factor is renewed, and what else is gone by.

    A factorisation costs as much as ten to fifteen steps.

    Attributes:
        memory: Steps that are remembered.
        evaluations_max: A state begins with a new factor if the last one took more evaluations.
        patience: In a state, after so many steps with a factor, it is renewed if the residual is
            still more than this share of the contact force.
        points: Points of the path that the next one is predicted by, at most.
    """

    memory: int = 16
    evaluations_max: int = 10
    patience: tuple[tuple[int, float], ...] = ((5, 1e-2), (10, 1e-3), (30, 0.0))
    points: int = 3


@dataclass(slots=True, kw_only=True)
class PreconditionedLbfgs:
    """Settles one indenter against one pad without friction, on the CPU.

    Attributes:
        factorisations: Made so far.
        evaluations: Of the forces, made so far.
    """

    model: Model
    indenter: Indenter
    potentials: Sequence[NodalPotential] = ()
    options: LbfgsOptions = field(default_factory=LbfgsOptions)
    factorisations: int = 0
    evaluations: int = 0
    _forces: NodalForces = field(init=False)
    _factor: _Factor = field(init=False)
    _memory: LimitedMemory = field(init=False)
    _last_evaluations: int = _NEVER
    _was_held: bool = True

    def __post_init__(self) -> None:
        extension = self.model.contact_options.extension
        self._forces = NodalForces(self.model, self.indenter, extension=extension)
        self._factor = _Factor(self.model, self.indenter, self.potentials)
        self._memory = LimitedMemory(self.options.memory)

    @property
    def solver_name(self) -> str:
        """What factors the stiffness."""
        return self._factor.solver.name

    def settle(
        self, state: State, *, load_n: float | None, residual_relative: float
    ) -> Equilibrium | None:
        """Move ``state`` to equilibrium; None if it does not come to rest, which spoils it.

        Args:
            load_n: Force that pushes the indenter down on the modelled part [N]; None holds it.
            residual_relative: Norm of the unbalanced force, and its sum along z, over the contact
                force.
        """
        state.extension = self.model.contact_options.extension
        search = _Search(self.model, state, load_n)
        if (load_n is None) != self._was_held:  # another unknown, the indenter's height
            self._memory.forget()
            self._was_held = load_n is None
        evaluations, factorisations = self.evaluations, self.factorisations
        if self._last_evaluations > self.options.evaluations_max:
            self._renew(state)
        gradient, steps, since = self._gradient(search), 0, 0
        while not self._is_enough(search, gradient, residual_relative):
            if self._is_worth_a_factor(self._residual(gradient) / self._scale_n(search), since):
                self._renew(state)
                since = 0
            if steps >= _STEPS_MAX or self.factorisations - factorisations > _FACTORS_MAX:
                return None
            moved = self._step(search, gradient)
            if moved is None:
                return None
            gradient, steps, since = moved, steps + 1, since + 1
        self._last_evaluations = self.evaluations - evaluations
        return self._equilibrium(state, gradient, steps)

    def _is_worth_a_factor(self, residual: float, since: int) -> bool:
        """Return whether a new factor saves more steps than it costs.

        Args:
            residual: Over the contact force.
            since: Steps of this state with the factor that there is.
        """
        return any(since >= steps and residual > left for steps, left in self.options.patience)

    def _step(self, search: _Search, gradient: FloatArray) -> FloatArray | None:
        """Go a step along which the energy falls; return the gradient there, None for none."""
        held = search.load_n is None
        if not held and not self._factor.touches:
            return None
        direction = self._memory.direction(gradient, lambda right: self._factor.solve(right, held))
        slope = float(gradient @ direction)
        if not slope < 0.0:
            self._memory.forget()
            direction = -self._factor.solve(gradient, held)
            slope = float(gradient @ direction)
        start, fraction = search.unknowns(), 1.0
        for _ in range(_TRIES):
            search.place(start + fraction * direction)
            there = self._gradient(search)
            ahead = float(there @ direction)
            if ahead <= _SLOPE_LEFT * abs(slope):
                self._memory.learn(fraction * direction, there - gradient)
                return there
            fraction *= max(_SHORTEST, abs(slope) / (abs(slope) + ahead))
        return None

    def _gradient(self, search: _Search) -> FloatArray:
        self.evaluations += 1
        nodal = self._forces.gradient(search.state)
        for potential in self.potentials:
            nodal = nodal + potential.gradient(search.state.positions)
        return search.reduced(nodal, float(self._forces.push[2]))

    def _is_enough(self, search: _Search, gradient: FloatArray, relative: float) -> bool:
        enough = max(relative * self._scale_n(search), self._floor_n)
        vertical = abs(float(gradient @ search.vertical))
        return self._residual(gradient) <= enough and vertical <= enough

    @property
    def _floor_n(self) -> float:
        return _FLOOR_SHARE * self.model.young_pa * self.model.height_m**2

    def _scale_n(self, search: _Search) -> float:
        touching = float(np.linalg.norm(self._forces.push))
        return max(touching, search.load_n or 0.0, self._floor_n)

    @staticmethod
    def _residual(gradient: FloatArray) -> float:
        return float(np.linalg.norm(gradient))

    def _renew(self, state: State) -> None:
        self._factor.renew(state)
        self._memory.forget()
        self.factorisations += 1

    def _equilibrium(self, state: State, gradient: FloatArray, steps: int) -> Equilibrium | None:
        ratio = self._forces.smallest_ratio()
        if not (self._forces.gap[0] > 0.0 and ratio > 0.0):
            return None
        return Equilibrium(
            iterations=steps,
            contact=self.model.surface.forces(state.positions, self.indenter, state),
            elastic_gradient=self._forces.elastic.copy(),
            residual_n=self._residual(gradient),
            min_jacobian=ratio,
        )


class _Search:
    """The unknowns of a state: its free nodes and, under a load, the indenter's height.

    Attributes:
        vertical: 1 where an unknown is a node's height; under a load the last is the indenter's.
    """

    def __init__(self, model: Model, state: State, load_n: float | None) -> None:
        self.state, self.load_n = state, load_n
        self._free = model.pattern.free_dofs
        heights = self._free % 3 == 2
        self.vertical = np.append(heights, [False] * (load_n is not None)).astype(np.float64)

    def unknowns(self) -> FloatArray:
        """Return nodes' coordinates and, under a load, the tip's height [m]."""
        nodes = self.state.positions.reshape(-1)[self._free]
        return nodes if self.load_n is None else np.append(nodes, self.state.tip[2])

    def place(self, unknowns: FloatArray) -> None:
        """Put the state there."""
        self.state.positions.reshape(-1)[self._free] = unknowns[: len(self._free)]
        if self.load_n is not None:
            self.state.tip[2] = unknowns[-1]

    def reduced(self, nodal: FloatArray, push_n: float) -> FloatArray:
        """Return the gradient by the unknowns [N]."""
        found = nodal.reshape(-1)[self._free]
        return found if self.load_n is None else np.append(found, self.load_n - push_n)


class _Factor:
    """The stiffness of one state, factored; the indenter's height borders it."""

    def __init__(
        self, model: Model, indenter: Indenter, potentials: Sequence[NodalPotential]
    ) -> None:
        self._model, self._indenter, self._potentials = model, indenter, potentials
        self.solver: LinearSolver = single_precision_solver(model.pattern)
        self._border = self._along = np.zeros(0)
        self._contact_n_m, self._corner = np.zeros(0), 0.0

    def renew(self, state: State) -> None:
        """Take another state's stiffness, made semidefinite where it is not."""
        try:
            self._factorise(state, safely=False)
        except NotPositiveDefiniteError:
            self._factorise(state, safely=True)

    @property
    def touches(self) -> bool:
        """The gel holds the indenter; without, a load has no direction to go by."""
        return self._corner > _HELD * self._model.young_pa * self._model.height_m

    def solve(self, right: FloatArray, held: bool) -> FloatArray:
        """Solve for the unknowns, without or with the indenter's height."""
        if held:
            return self.solver.solve(right)
        if not self._along.size:
            pushed = self._model.surface.scatter(-self._contact_n_m[..., 2])
            self._border = self._model.pattern.unknowns(pushed)
            self._along = self.solver.solve(self._border)
            self._corner -= float(self._border @ self._along)
        nodes = self.solver.solve(right[:-1])
        rise = (right[-1] - self._border @ nodes) / self._corner
        return np.append(nodes - rise * self._along, rise)

    def _factorise(self, state: State, *, safely: bool) -> None:
        model = self._model
        contact = model.surface.forces(state.positions, self._indenter, state, curved=not safely)
        data = model.hessian_data(state.positions, contact.stiffness, projected=safely)
        for potential in self._potentials:
            data[model.pattern.indptr[:-1]] += model.pattern.unknowns(potential.diagonal())
        self.solver.factorise(data)
        self._along, self._contact_n_m = np.zeros(0), contact.stiffness
        self._corner = float(contact.stiffness[..., 2, 2].sum())
