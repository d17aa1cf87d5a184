"""Equilibrium of a pad under one indenter, held still or pushed with a given force.

Every step goes along minus the inverse of a stiffness times the unbalanced force. That stiffness is
a recent state's, corrected by what the last steps have shown of the present one
(``LimitedMemory``): a step then costs one evaluation of the forces and one solution. It is factored
anew where steps gain too little, at every step if need be, which is Newton's method. A step lowers
the energy, limits overlap, and ends where the force along it is no longer large.

Steps may begin with the surfaces slightly overlapping; they end with every gap positive or not at
all. They end when the residual, the norm of the unbalanced force, is

- *enough*: at most ``residual_relative`` of the contact force, the floor, or what rounding alone
  leaves of it;
- or *at a standstill that does no harm*: none of the last steps brought it below nine tenths of
  what it was before them, the stiffness is of one of them, and it is at most 3e-7 of the contact
  force or ten times the rounding's estimate. Rounding does that, and a contact point that goes on
  and off in turn.

At a standstill further up they go on. After ``iteration_max`` steps a residual that does no harm is
taken, and any other is an error.

Where friction holds points to the indenter, their pressure is lagged: it is taken over between
steps as soon as the residual is small, and has to stand still at the end. What is bonded knows no
pressure: points that have come to touch take hold once the steps have ended.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.contact.state import ContactForces, Grip, State
from sim.device import KERNEL_EPSILON
from sim.scene.indenter import Indenter
from sim.solve.evaluation import Evaluation, Evaluator, NodalPotential
from sim.solve.limited_memory import LimitedMemory
from sim.solve.model import Model
from sim.solve.overlap import OVERLAP_SHARE, allowed_fraction, refuse_deep_overlap
from sim.solve.stiffness_factor import StiffnessFactor
from sim.solve.untangle import TANGLED_SHARE, inverted_share, untangle
from tacauchy_rig.errors import ConvergenceError

logger = logging.getLogger(__name__)

# A residual that is always enough, over E H^2 with the pad's height H.
_FLOOR_SHARE = 1.5e-11
# A residual over the contact force that tells whether the barrier has to be extended less.
_ROUGH = 1e-3
# Shares of d_hat below which the barrier is a parabola, tried one after the other.
_EXTENSIONS = (0.25, 0.1, 0.03, 0.01, 0.003, 0.001)
# A residual over the contact force that changes no result that is reported.
_HARMLESS_SHARE = 3e-7
# A residual over the contact force below which it may be rounding's.
_SMALL_SHARE = 1e-6
# The rounding's estimate may be short by this.
_ROUNDING_DOUBT = 10.0
# A standstill: this many steps leave more than this share of the residual before them.
_WINDOW, _LEFT = 5, 0.9
# Share of the slope that a step may end with (Wolfe's second condition; Nocedal and Wright, 3.1):
# a little where rounding hides the energy's change.
_SLOPE_LEFT, _SLOPE_LEFT_IN_NOISE = 0.9, 0.3
# Share of the slope that the energy falls by at least (Armijo; Nocedal and Wright, 3.1).
_ARMIJO = 1e-4
# A step is halved where the energy rises, and shortened to no less than this by the slopes.
_HALF, _SHORTEST, _TRIES = 0.5, 0.1, 40
# Of the pad's height: the longest step of an indenter that is pushed and touches nothing.
_TIP_STEP_SHARE = 0.025
# Rounding of a sum of energies, in units in the last place of the sum and of E times the volume.
_ROUNDING_OF_SUM, _ROUNDING_OF_SCALE = 4500.0, 4.5
# Lagged pressure is taken over where the residual is below this share of the contact force, and of
# the residual when it was taken over last.
_GRIP_FROM, _GRIP_AGAIN = 0.1, 0.2
# The friction limit, summed over the points, may still change by this over itself.
_GRIP_CHANGE, _GRIP_PER_RESIDUAL = 1e-4, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverOptions:
    """When the steps stop.

    Attributes:
        residual_relative: Residual norm over the contact force's norm.
        residual_floor_n: Residual norm that is always enough [N], as is the rounding's; None is
            1.5e-11 E H^2 with the pad's height H, so that it scales with the problem.
        iteration_max: Most steps for one form of the barrier, which is relaxed where gel stays too
            near; each form begins to count anew.
    """

    residual_relative: float = 1e-8
    residual_floor_n: float | None = None
    iteration_max: int = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Reuse:
    """What is kept from step to step; a factor costs as much as ten to fifteen steps.

    Attributes:
        memory: Steps that are remembered.
        evaluations_max: A state begins with a new factor if the last one took more evaluations.
        patience: In a state, after so many steps with a factor, it is renewed if the residual is
            still more than this share of the contact force.
    """

    memory: int = 16
    evaluations_max: int = 10
    patience: tuple[tuple[int, float], ...] = ((5, 1e-2), (10, 1e-3), (30, 0.0))


NEWTON = Reuse(memory=0, evaluations_max=0, patience=((1, 0.0),))
"""Newton's method: a factor for every step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A converged state's numbers.

    Attributes:
        iterations: Steps taken.
        contact: Contact forces at the last positions.
        elastic_gradient: Gradient of the elastic energy [N], shape [node_count, 3].
        residual_n: Norm of the unbalanced force [N].
        stalled: The residual is above what was asked, relative and floor: rounding, a standstill
            or the last iteration ended the steps at one that does no harm.
    """

    iterations: int
    contact: ContactForces
    elastic_gradient: FloatArray
    residual_n: float
    min_jacobian: float
    stalled: bool = False


class EquilibriumSolver:
    """Settles one indenter against one pad, again and again, and keeps what helps the next time.

    Args:
        potentials: Further energies of the nodes: weight, inertia.

    Attributes:
        factor: The stiffness that was factored last.
        memory: What the last steps have shown of the present one.
        evaluations: Of the forces, made so far.
        energies_j: Of the states after every step of the last equilibrium.
    """

    def __init__(
        self,
        model: Model,
        indenter: Indenter,
        potentials: Sequence[NodalPotential] = (),
        *,
        reuse: Reuse | None = None,
    ) -> None:
        self.model, self.indenter, self.reuse = model, indenter, reuse or Reuse()
        self.evaluator = Evaluator(model, indenter, potentials)
        self.factor = StiffnessFactor(model, indenter, potentials)
        self.evaluations = 0
        self.energies_j: list[float] = []
        self.memory = LimitedMemory(self.reuse.memory)
        self._begins_anew = True
        self._was_held = True

    def replace_potentials(self, potentials: Sequence[NodalPotential]) -> None:
        """Take other energies of the nodes from now on."""
        self.evaluator.potentials = self.factor.potentials = potentials

    def settle(
        self, state: State, *, load_n: float | None = None, options: SolverOptions
    ) -> Equilibrium:
        """Move ``state`` to equilibrium.

        Args:
            load_n: Force that pushes the indenter down on the modelled part [N]; None holds it.

        Raises:
            ConvergenceError: No equilibrium was found; ``state`` is left where the steps stopped.
        """
        spent = self._untangled(state)
        refuse_deep_overlap(self.model, self.indenter, state)
        if (load_n is None) != self._was_held:  # another unknown, the indenter's height
            self.memory.forget()
            self._was_held = load_n is None
        if self.model.relaxation is not None:
            self.evaluator.renew_memory()
        contact, self.energies_j, grip_start = self.model.contact_options, [], state.grip
        begins_anew = self._begins_anew
        self._begins_anew = True  # where this one fails
        for extension in (contact.extension, *_EXTENSIONS):
            state.extension = extension
            descent = _Descent(self, state, load_n, options, grip_start=grip_start)
            least = contact.gap_least_m(extension)
            if descent.run(least, begins_anew=begins_anew):
                self._begins_anew = descent.evaluations > self.reuse.evaluations_max
                return descent.equilibrium(spent)
            spent, begins_anew = spent + descent.steps, True
        raise ConvergenceError(
            "the gel is pressed through the contact barrier: smallest gap "
            f"{descent.now.gaps.min() * 1e9:.3g} nm",
            remedy="give the indenter a fillet, coarsen the mesh at its rim, or widen the barrier",
        )

    def evaluate(self, state: State) -> Evaluation:
        """Evaluate a state."""
        self.evaluations += 1
        return self.evaluator.at(state)

    def _untangled(self, state: State) -> int:
        """Turn a start inside out the right way round, if that lowers the energy; say how often."""
        model, start = self.model, state.positions
        if model.gel.energy(start)[1] > 0.0 or inverted_share(model, start) < TANGLED_SHARE:
            return 0
        before, found = self.evaluator.at(state).energy_j, untangle(model, start)
        state.positions = found.positions
        if self.evaluator.at(state).energy_j > before:
            state.positions = start
        logger.debug("untangled in %d passes, %.3g left", found.passes, found.inverted_share)
        return found.passes

    def take_factor(self, state: State, *, first: int = 0) -> None:
        """Factor a state's stiffness; what was learnt of another is forgotten."""
        self.factor.renew(state, first=first)
        self.memory.forget()

    def direction(self, gradient: FloatArray, *, held: bool) -> FloatArray:
        """Return the way to go from a gradient by the unknowns [N]."""
        return self.memory.direction(gradient, lambda right: self.factor.solve(right, held=held))


class _Descent:
    """The steps of one state with one form of the barrier.

    Attributes:
        steps: Taken so far.
        now: The state's energy and forces.
        residual_n: Norm of the unbalanced force [N].
    """

    def __init__(
        self,
        solver: EquilibriumSolver,
        state: State,
        load_n: float | None,
        options: SolverOptions,
        *,
        grip_start: Grip | None,
    ) -> None:
        self._solver, self.state, self._load_n, self._options = solver, state, load_n, options
        self._model = model = solver.model
        self._free = model.pattern.free_dofs
        heights = (self._free % 3 == 2).astype(np.float64)
        self._vertical = heights if load_n is None else np.append(heights, 0.0)
        self._residuals: list[float] = []
        self._lags = model.contact_options.friction > 0.0
        self._grip_change = np.inf if self._lags else 0.0
        self._grip_start = grip_start
        self._gripped_at_n = np.inf
        self._since = 0
        self._before = solver.evaluations
        self.steps = 0
        self._take(solver.evaluate(state))

    def run(self, gap_least_m: float, *, begins_anew: bool) -> bool:
        """Step until the residual is enough; return whether every gap is at least this wide [m].

        Args:
            begins_anew: Begin with a factor of this very state.

        Raises:
            ConvergenceError: There is no way down, or too many steps were taken.
        """
        solver, rough = self._solver, True
        if begins_anew:
            self._renew()
        while True:
            self._lag_grip()
            self._residuals.append(self.residual_n)
            if not np.isfinite(self.residual_n):
                raise ConvergenceError(
                    f"the residual is not finite after {self.steps} steps",
                    remedy="press in smaller steps or use the stable-neo-hookean law",
                )
            if rough and self.residual_n <= _ROUGH * self._scale_n:
                # Where the barrier has to be extended less, the rest would be for nothing.
                rough = False
                if self.now.gaps.min() < gap_least_m:
                    return False
            if self._ends():
                return bool(self.now.gaps.min() >= gap_least_m)
            if any(
                self._since >= steps and self.residual_n > left * self._scale_n
                for steps, left in solver.reuse.patience
            ):
                self._renew()
            self._step()
            self.steps, self._since = self.steps + 1, self._since + 1
            solver.energies_j.append(self._energy_j(self.now))

    @property
    def evaluations(self) -> int:
        """Made so far."""
        return self._solver.evaluations - self._before

    def equilibrium(self, spent: int) -> Equilibrium:
        """Return what was found, ``spent`` steps of other forms of the barrier included."""
        state = self.state
        return Equilibrium(
            iterations=spent + self.steps,
            contact=self._model.surface.forces(state.positions, self._solver.indenter, state),
            elastic_gradient=self.now.elastic,
            residual_n=self.residual_n,
            min_jacobian=self.now.ratio_min,
            stalled=self.residual_n > self._asked_n,
        )

    @property
    def _asked_n(self) -> float:
        floor = self._options.residual_floor_n
        if floor is None:
            floor = _FLOOR_SHARE * self._model.young_pa * self._model.height_m**2
        return max(self._options.residual_relative * self._scale_n, floor)

    def _ends(self) -> bool:
        """Apply the rule of this module.

        Raises:
            ConvergenceError: The steps are used up, and the residual would do harm.
        """
        last, asked = self.residual_n, self._asked_n
        spent = len(self._residuals) - 1
        is_last = spent >= self._options.iteration_max
        settled = self._grip_change <= max(
            _GRIP_CHANGE, _GRIP_PER_RESIDUAL * self._options.residual_relative
        )
        # Parts that lean the same way add up to more along z than their norm says.
        vertical = abs(float(self._gradient @ self._vertical))
        if last <= asked and vertical <= asked and settled:
            return True
        is_small = last <= _SMALL_SHARE * self._scale_n
        if not (is_last or is_small or stands_still(self._residuals)):
            return False
        rounding = self._rounding_n
        if last <= rounding and settled:
            return True
        harmless = max(_HARMLESS_SHARE * self._scale_n, _ROUNDING_DOUBT * rounding)
        if last <= harmless and settled:
            if is_last or (stands_still(self._residuals) and self._since <= _WINDOW):
                return True
            if stands_still(self._residuals):
                self._renew()
        if is_last:
            raise ConvergenceError(
                f"no equilibrium after {spent} steps: residual {last:.3g} N at a contact force of "
                f"{self._scale_n:.4g} N",
                remedy="press in smaller steps, or refine the mesh near the indenter's rim",
            )
        return False

    @property
    def _rounding_n(self) -> float:
        state = self.state
        found = self._model.surface.forces(state.positions, self._solver.indenter, state)
        return self._model.rounding_n(found)

    def _lag_grip(self) -> None:
        """Let points that touch hold on with the pressure of now, as soon as that means much."""
        state, residual = self.state, self.residual_n
        due = min(_GRIP_FROM * self._scale_n, _GRIP_AGAIN * self._gripped_at_n)
        if not self._lags or residual > max(due, self._asked_n):
            return
        self._grip_change = self._model.surface.refresh_grip(
            self._solver.indenter, state, start=self._grip_start
        )
        self._take(self._solver.evaluate(state))
        self._gripped_at_n = self.residual_n

    def _step(self) -> None:
        """Go a step along which the energy falls.

        Raises:
            ConvergenceError: Nowhere along it is the energy lower.
        """
        while True:
            direction = self._direction()
            slope = float(self._gradient @ direction)
            if slope < 0.0 and self._moved(direction, slope):
                return
            if len(self._solver.memory) or self._since:
                self._renew()
            elif self._solver.factor.attempt == 0:
                self._renew(first=1)
            else:
                raise ConvergenceError(
                    f"the line search found no descent along a direction of slope {slope:.3g} J",
                    remedy="press in smaller steps",
                )

    def _direction(self) -> FloatArray:
        held = self._load_n is None
        if held or self._solver.factor.touches:
            return self._solver.direction(self._gradient, held=held)
        if self.now.push_n.any():  # it has come to touch since
            self._renew()
            return self._solver.direction(self._gradient, held=held)
        # Without contact nothing holds the indenter, and it is brought down by the longest step.
        down = np.zeros_like(self._gradient)
        down[-1] = -np.sign(self._gradient[-1]) * _TIP_STEP_SHARE * self._model.height_m
        return down

    def _moved(self, direction: FloatArray, slope: float) -> bool:
        """Go along a direction as far as overlap, energy and slope allow; False for nowhere."""
        solver, now, start = self._solver, self.now, self._unknowns()
        before, energy = self._gradient, self._energy_j(now)
        # Rounding of the summed energy: below it only the gradient can tell which way is down.
        noise = KERNEL_EPSILON * (
            _ROUNDING_OF_SUM * abs(energy) + _ROUNDING_OF_SCALE * self._model.energy_scale_j
        )
        floor = np.minimum(-OVERLAP_SHARE * self._model.height_m, now.gaps)
        fraction = 1.0
        for _ in range(_TRIES):
            self._place(start + fraction * direction)
            there = solver.evaluate(self.state)
            allowed = allowed_fraction(now.gaps, there.gaps, floor)
            if allowed < 1.0:
                fraction *= allowed
                continue
            gradient, change = self._reduced(there), self._energy_j(there) - energy
            ahead = float(gradient @ direction)
            in_noise = abs(change) <= noise
            left = _SLOPE_LEFT_IN_NOISE if in_noise else _SLOPE_LEFT
            falls = in_noise or change <= _ARMIJO * fraction * slope
            if falls and ahead <= left * abs(slope):
                solver.memory.learn(fraction * direction, gradient - before)
                self._take(there, gradient)
                return True
            if ahead > 0.0:
                fraction *= max(_SHORTEST, abs(slope) / (abs(slope) + ahead))
            else:
                fraction *= _HALF
        self._place(start)
        return False

    def _renew(self, *, first: int = 0) -> None:
        self._solver.take_factor(self.state, first=first)
        self._since = 0

    def _take(self, found: Evaluation, gradient: FloatArray | None = None) -> None:
        self.now = found
        self._gradient = self._reduced(found) if gradient is None else gradient
        self.residual_n = float(np.linalg.norm(self._gradient))
        self._scale_n = max(float(np.linalg.norm(found.push_n)), self._load_n or 0.0)

    def _energy_j(self, found: Evaluation) -> float:
        lifted = 0.0 if self._load_n is None else self._load_n * float(self.state.tip[2])
        return found.energy_j + lifted

    def _unknowns(self) -> FloatArray:
        """Return nodes' coordinates and, under a load, the tip's height [m]."""
        nodes = self.state.positions.reshape(-1)[self._free]
        return nodes if self._load_n is None else np.append(nodes, self.state.tip[2])

    def _place(self, unknowns: FloatArray) -> None:
        """Put the state there."""
        self.state.positions.reshape(-1)[self._free] = unknowns[: len(self._free)]
        if self._load_n is not None:
            self.state.tip[2] = unknowns[-1]

    def _reduced(self, found: Evaluation) -> FloatArray:
        """Return the gradient by the unknowns [N]."""
        nodal = found.gradient.reshape(-1)[self._free]
        if self._load_n is None:
            return nodal
        return np.append(nodal, self._load_n - float(found.push_n[2]))


def stands_still(residuals: Sequence[float]) -> bool:
    """Return whether the last iterations took less than a tenth off the residual before them."""
    recent = residuals[-_WINDOW:]
    return len(residuals) > _WINDOW and min(recent) > _LEFT * residuals[-1 - _WINDOW]
