"""What is to be balanced, and one Newton step towards it.

A step factors the exact Hessian; only when that is not positive definite, or an element is
inverted, is it replaced by a semidefinite one. The line search limits overlap and lowers the
energy.

Under a given force the height z of the indenter is one more unknown, and F z is added to the
energy. Its row and column border the stiffness matrix, so that one factorisation and two solves
give a step of both.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.arrays import FloatArray
from sim.contact.state import ContactForces, State
from sim.device import KERNEL_EPSILON
from sim.scene.indenter import Indenter
from sim.solve.linear_solver import LinearSolver, NotPositiveDefiniteError
from sim.solve.model import Model
from sim.solve.overlap import overlap_fraction
from tacauchy_rig.errors import ConvergenceError

logger = logging.getLogger(__name__)
# Where rounding hides the energy's change: share of the slope that a step may end with.
_SLOPE_LEFT = 0.3
# Share of the slope that the energy falls by at least (Armijo; Nocedal and Wright, 3.1).
_ARMIJO = 1e-4
# A step is halved where the energy rises, and shortened to no less than this by the slopes.
_HALF, _SHORTEST, _TRIES = 0.5, 0.1, 40
# Shares of the undeformed pad's stiffness that are added until the matrix is positive definite.
_SHIFTS = (0.0, 1e-3, 1e-1, 1.0)
# Of the pad's height: the longest step of an indenter that is pushed.
_TIP_STEP_SHARE = 0.025
# A stiffness that is none, over E H with the pad's height H.
_HELD = 1e-13
# Rounding of a sum of energies, in units in the last place of the sum and of E times the volume.
_ROUNDING_OF_SUM, _ROUNDING_OF_SCALE = 4500.0, 4.5


class NodalPotential(Protocol):
    """An energy whose stiffness is a constant diagonal."""

    def energy(self, positions: FloatArray) -> float:
        """Return the energy at nodal positions [m], shape [node_count, 3]; [J]."""
        ...

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return its gradient [N], shape [node_count, 3]."""
        ...

    def diagonal(self) -> FloatArray:
        """Return its stiffness [N/m], shape [node_count, 3]."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Balance:
    """Forces at a state.

    Attributes:
        contact: At every contact point.
        elastic: Gradient of the elastic energy [N], shape [node_count, 3].
        gradient: Unbalanced force on the unknowns [N], shape [unknown_count].
        tip_n: Unbalanced force on the indenter along -z [N].
        scale_n: Size of the contact force, or of the load if that is larger [N].
    """

    contact: ContactForces
    elastic: FloatArray
    gradient: FloatArray
    tip_n: float
    scale_n: float

    @property
    def residual_n(self) -> float:
        """Norm of the unbalanced force [N]."""
        return float(np.hypot(np.linalg.norm(self.gradient), self.tip_n))


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A Newton step: of the unknowns [m], of the indenter's height [m]; slope of the energy [J]."""

    unknowns: FloatArray
    rise_m: float
    slope_j: float


@dataclass(frozen=True, slots=True)
class Problem:
    """What is to be balanced.

    Attributes:
        load_n: Force that pushes the indenter down on the modelled part [N]; its height is then
            found. None holds it still.
        potentials: Further energies of the nodes: weight, inertia.
    """

    model: Model
    solver: LinearSolver
    indenter: Indenter
    load_n: float | None = None
    potentials: Sequence[NodalPotential] = ()

    def balance(self, state: State) -> Balance:
        """Sum the forces at a state."""
        model = self.model
        contact = model.surface.forces(state.positions, self.indenter, state)
        elastic = model.gel.gradient(state.positions)
        nodal = elastic + model.surface.scatter(contact.forces)
        for potential in self.potentials:
            nodal = nodal + potential.gradient(state.positions)
        push = contact.forces.reshape(-1, 3).sum(axis=0)
        scale = float(np.linalg.norm(push))
        load = self.load_n
        return Balance(
            contact=contact,
            elastic=elastic,
            gradient=model.pattern.unknowns(nodal),
            tip_n=0.0 if load is None else load - float(push[2]),
            scale_n=scale if load is None else max(scale, load),
        )

    def energy(self, state: State) -> float:
        """Return the energy of a state [J]."""
        total, _ = self.model.gel.energy(state.positions)
        total += self.model.surface.energy(state.positions, self.indenter, state)
        for potential in self.potentials:
            total += potential.energy(state.positions)
        return total if self.load_n is None else total + self.load_n * float(state.tip[2])

    def factorise(self, state: State, stiffness: FloatArray, *, attempt: int = 0) -> None:
        """Factor the Newton matrix; later attempts replace it by ever safer ones.

        Raises:
            NotPositiveDefiniteError: The matrix is not positive definite.
        """
        shift = (0.0, *_SHIFTS)[attempt]
        data = self.model.hessian_data(state.positions, stiffness, projected=attempt > 0)
        if shift > 0.0:
            data = data + shift * self.model.rest_hessian_data()
        diagonal = self.model.pattern.indptr[:-1]
        for potential in self.potentials:
            data[diagonal] += self.model.pattern.unknowns(potential.diagonal())
        self.solver.factorise(data)

    def factorise_safely(
        self, state: State, contact: ContactForces, *, first: int = 0
    ) -> tuple[ContactForces, int]:
        """Factor the Newton matrix, or the first safer one that is positive definite.

        Args:
            first: Attempt to begin with.

        Returns:
            The contact whose stiffness is in it, and the number of the attempt.

        Raises:
            ConvergenceError: No safe matrix was found.
        """
        for attempt in range(first, 1 + len(_SHIFTS)):
            if attempt == 1:
                contact = self.model.surface.forces(
                    state.positions, self.indenter, state, curved=False
                )
            try:
                self.factorise(state, contact.stiffness, attempt=attempt)
            except NotPositiveDefiniteError:
                logger.debug("Hessian not positive definite (attempt %d)", attempt)
            else:
                return contact, attempt
        raise ConvergenceError(
            "the stiffness matrix is not positive definite even when projected and shifted",
            remedy="the mesh has degenerate tetrahedra or lost its clamped base: check it",
        )

    def step(self, state: State, balance: Balance) -> Step:
        """Return the Newton step, which goes down.

        Raises:
            ConvergenceError: No safe matrix was found.
        """
        contact, attempt = self.factorise_safely(state, balance.contact)
        step = self._solve(balance, contact.stiffness)
        if step.slope_j >= 0.0 and attempt == 0:
            contact, _ = self.factorise_safely(state, contact, first=1)
            step = self._solve(balance, contact.stiffness)
        return step

    def _solve(self, balance: Balance, stiffness: FloatArray) -> Step:
        gradient = balance.gradient
        unknowns = -self.solver.solve(gradient)
        if self.load_n is None:
            return Step(unknowns=unknowns, rise_m=0.0, slope_j=float(gradient @ unknowns))
        border = self.model.pattern.unknowns(self.model.surface.scatter(-stiffness[..., 2]))
        along = -self.solver.solve(border)
        corner = float(stiffness[..., 2, 2].sum()) + float(border @ along)
        pull = balance.tip_n + float(border @ unknowns)
        # Without contact nothing holds the indenter, and it is brought down by the largest step.
        longest = _TIP_STEP_SHARE * self.model.height_m
        held = corner > _HELD * self.model.young_pa * self.model.height_m
        rise = -pull / corner if held else -np.inf * pull
        rise = float(np.clip(rise, -longest, longest)) if pull else 0.0
        unknowns = unknowns + rise * along
        slope = float(gradient @ unknowns) + balance.tip_n * rise
        return Step(unknowns=unknowns, rise_m=rise, slope_j=slope)

    def move(self, state: State, step: Step) -> None:
        """Go along a step as far as overlap and energy allow.

        Raises:
            ConvergenceError: Nowhere along it is the energy lower.
        """
        model, full = self.model, self.model.pattern.nodal(step.unknowns)
        start, tip = state.positions, state.tip
        rise = np.array([0.0, 0.0, step.rise_m])
        fraction = overlap_fraction(model, self.indenter, state, tip + rise, full)
        energy, slope = self.energy(state), step.slope_j
        # Rounding of the summed energy: below it only the gradient can tell which way is down.
        noise = KERNEL_EPSILON * (
            _ROUNDING_OF_SUM * abs(energy) + _ROUNDING_OF_SCALE * model.energy_scale_j
        )
        for _ in range(_TRIES):
            state.positions = start + fraction * full
            state.tip = tip + fraction * rise
            change = self.energy(state) - energy
            if abs(change) <= noise:
                balance = self.balance(state)
                ahead = float(balance.gradient @ step.unknowns) + balance.tip_n * step.rise_m
                if ahead <= _SLOPE_LEFT * abs(slope):
                    return
                fraction *= max(_SHORTEST, abs(slope) / (abs(slope) + ahead))
            elif change <= _ARMIJO * fraction * slope:
                return
            else:
                fraction *= _HALF
        state.positions, state.tip = start, tip
        raise ConvergenceError(
            f"the line search found no descent along a direction of slope {slope:.3g} J",
            remedy="press in smaller steps",
        )
