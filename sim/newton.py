"""Newton's method for an equilibrium: the indenter held still, or pushed with a given force.

Each iteration factors the exact Hessian; only when that is not positive definite, or an element is
inverted, is it replaced by a semidefinite one. The line search limits overlap and lowers the
energy. Newton may start with the surfaces slightly overlapping; it ends with every gap positive or
not at all.

Under a given force the height z of the indenter is one more unknown, and F z is added to the
energy. Its row and column border the stiffness matrix, so that one factorisation and two solves
give a step of both.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.indenter import Indenter
from sim.linear_solver import LinearSolver, NotPositiveDefiniteError
from sim.model import KERNEL_EPSILON, Model
from sim.potentials import NodalPotential
from sim.state import ContactForces, State
from sim.untangle import TANGLED_SHARE, inverted_share, untangle
from tacauchy_rig.errors import ConvergenceError

logger = logging.getLogger(__name__)

OVERLAP_SHARE = 0.005
_FLOOR_SHARE = 1.5e-11
_PENETRATION_SHARE = 0.3
_FACING = 0.5
_ROUGH = 1e-3
_EXTENSIONS = (0.5, 0.25, 0.1, 0.03, 0.01, 0.003, 0.001)
_SLOPE_LEFT = 0.3
_SHIFTS = (0.0, 1e-3, 1e-1, 1.0)
_TIP_STEP_SHARE = 0.025
# The rounding's estimate may be short by this; Newton is then seen to stand still.
_ROUNDING_DOUBT = 10.0
# A contact point that goes on and off in turn can keep a residual just above what was asked.
_NEAR_ENOUGH, _HOVERING = 10.0, 8
# Where the tangent has to be made semidefinite to the end, Newton converges but linearly.
_ACCEPTABLE = 3e-7
_STANDSTILL = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class NewtonOptions:
    """When Newton stops.

    Attributes:
        residual_relative: Residual norm over the contact force's norm.
        residual_floor_n: Residual norm that is always enough [N], as is the rounding's; None is
            1.5e-11 E H^2 with the pad's height H, so that it scales with the problem.
    """

    residual_relative: float = 1e-8
    residual_floor_n: float | None = None
    iteration_max: int = 150


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A converged state's numbers.

    Attributes:
        iterations: Factorisations spent.
        contact: Contact forces at the last positions.
        elastic_gradient: Gradient of the elastic energy [N], shape [node_count, 3].
        residual_n: Norm of the unbalanced force [N].
        stalled: Newton ended before its tolerance was met: by rounding, hovering within ten times
            the tolerance, or out of iterations below 3e-7 of the contact force.
    """

    iterations: int
    contact: ContactForces
    elastic_gradient: FloatArray
    residual_n: float
    min_jacobian: float
    stalled: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Balance:
    """Forces at a state; ``tip_n`` is the unbalanced force on the indenter along -z [N]."""

    contact: ContactForces
    elastic: FloatArray
    gradient: FloatArray
    tip_n: float
    scale_n: float

    @property
    def residual_n(self) -> float:
        return float(np.hypot(np.linalg.norm(self.gradient), self.tip_n))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Step:
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

    def balance(self, state: State) -> _Balance:
        """Sum the forces at a state."""
        model = self.model
        contact = model.contact_forces(state.positions, self.indenter, state)
        elastic = model.elastic_gradient(state.positions)
        nodal = elastic + model.scatter(contact.forces)
        for potential in self.potentials:
            nodal = nodal + potential.gradient(state.positions)
        push = contact.forces.reshape(-1, 3).sum(axis=0)
        scale = float(np.linalg.norm(push))
        load = self.load_n
        return _Balance(
            contact=contact,
            elastic=elastic,
            gradient=model.pattern.unknowns(nodal),
            tip_n=0.0 if load is None else load - float(push[2]),
            scale_n=scale if load is None else max(scale, load),
        )

    def energy(self, state: State) -> float:
        """Return the energy of a state [J]."""
        total, _ = self.model.elastic_energy(state.positions)
        total += self.model.contact_energy(state.positions, self.indenter, state)
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
                contact = self.model.contact_forces(
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

    def step(self, state: State, balance: _Balance) -> _Step:
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

    def _solve(self, balance: _Balance, stiffness: FloatArray) -> _Step:
        gradient = balance.gradient
        unknowns = -self.solver.solve(gradient)
        if self.load_n is None:
            return _Step(unknowns=unknowns, rise_m=0.0, slope_j=float(gradient @ unknowns))
        border = self.model.pattern.unknowns(self.model.scatter(-stiffness[..., 2]))
        along = -self.solver.solve(border)
        corner = float(stiffness[..., 2, 2].sum()) + float(border @ along)
        pull = balance.tip_n + float(border @ unknowns)
        # Without contact nothing holds the indenter, and it is brought down by the largest step.
        longest = _TIP_STEP_SHARE * self.model.height_m
        held = corner > 1e-13 * self.model.young_pa * self.model.height_m
        rise = -pull / corner if held else -np.inf * pull
        rise = float(np.clip(rise, -longest, longest)) if pull else 0.0
        unknowns = unknowns + rise * along
        slope = float(gradient @ unknowns) + balance.tip_n * rise
        return _Step(unknowns=unknowns, rise_m=rise, slope_j=slope)

    def move(self, state: State, step: _Step) -> None:
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
        noise = KERNEL_EPSILON * (4500.0 * abs(energy) + 4.5 * model.energy_scale_j)
        for _ in range(40):
            state.positions = start + fraction * full
            state.tip = tip + fraction * rise
            change = self.energy(state) - energy
            if abs(change) <= noise:
                balance = self.balance(state)
                ahead = float(balance.gradient @ step.unknowns) + balance.tip_n * step.rise_m
                if ahead <= _SLOPE_LEFT * abs(slope):
                    return
                fraction *= max(0.1, abs(slope) / (abs(slope) + ahead))
            elif change <= 1e-4 * fraction * slope:
                return
            else:
                fraction *= 0.5
        state.positions, state.tip = start, tip
        raise ConvergenceError(
            f"the line search found no descent along a direction of slope {slope:.3g} J",
            remedy="press in smaller steps",
        )


def equilibrate(problem: Problem, state: State, *, options: NewtonOptions) -> Equilibrium:
    """Move ``state`` to equilibrium; on return the problem's solver holds a recent factor.

    Raises:
        ConvergenceError: No equilibrium was found; ``state`` is left where Newton stopped.
    """
    iterations = _untangle(problem, state)
    _refuse_deep_overlap(problem, state)
    distance = problem.model.contact_options.distance_m
    rough = replace(options, residual_relative=max(options.residual_relative, _ROUGH))
    for extension in _EXTENSIONS:
        state.extension = extension
        # Roughly first: where the barrier has to be extended less, the rest would be for nothing.
        for wanted in (rough, options):
            found = _descend(problem, state, options=wanted, spent=iterations)
            iterations = found.iterations
            gaps = problem.model.gaps(state.positions, problem.indenter, state)
            if gaps.min() < extension * distance:
                break
        else:
            return found
    raise ConvergenceError(
        f"the gel is pressed through the contact barrier: smallest gap {gaps.min() * 1e9:.3g} nm",
        remedy="give the indenter a fillet, coarsen the mesh at its rim, or enlarge the barrier",
    )


def _refuse_deep_overlap(problem: Problem, state: State) -> None:
    """End where gel starts so far inside the indenter that its nearest side may be the wrong one.

    Raises:
        ConvergenceError: The overlap is 30 % of the pad's height or more, or the nearest side at
            the deepest point does not face the gel.
    """
    model = problem.model
    gaps = model.gaps(state.positions, problem.indenter, state)
    deepest = -float(gaps.min())
    if deepest <= 2.0 * OVERLAP_SHARE * model.height_m:
        return
    told = f"the gel starts {deepest * 1e3:.3g} mm inside the indenter"
    remedy = "start with the indenter above the gel and press it in"
    if deepest >= _PENETRATION_SHARE * model.height_m:
        raise ConvergenceError(told, remedy=remedy)
    at = np.unravel_index(np.argmin(gaps), gaps.shape)
    push = model.contact_forces(state.positions, problem.indenter, state).forces[at]
    outward = model.deformed_area_vectors(state.positions)[at]
    if push @ outward < _FACING * np.linalg.norm(push) * np.linalg.norm(outward):
        raise ConvergenceError(
            f"{told}, where its nearest side does not face the gel", remedy=remedy
        )


def _untangle(problem: Problem, state: State) -> int:
    """Turn a start inside out the right way round, if that lowers the energy; return the solves."""
    model, start = problem.model, state.positions
    if model.elastic_energy(start)[1] > 0.0 or inverted_share(model, start) < TANGLED_SHARE:
        return 0
    before, found = problem.energy(state), untangle(model, start)
    state.positions = found.positions
    if problem.energy(state) > before:
        state.positions = start
    logger.debug("untangled in %d passes, %.3g left", found.passes, found.inverted_share)
    return found.passes


def _descend(problem: Problem, state: State, *, options: NewtonOptions, spent: int) -> Equilibrium:
    iterations = spent
    residuals: list[float] = []
    while True:
        balance = problem.balance(state)
        residual, scale = balance.residual_n, balance.scale_n
        residuals.append(residual)
        if not np.isfinite(residual):
            raise ConvergenceError(
                f"the residual is not finite after {iterations} Newton iterations",
                remedy="press in smaller steps or use the stable-neo-hookean law",
            )
        asked = max(options.residual_relative * scale, _floor(problem.model, options))
        rounding = problem.model.rounding_n(balance.contact)
        used_up = iterations - spent >= options.iteration_max
        near = residual <= max(asked, _ACCEPTABLE * scale) and used_up
        if (
            residual <= asked
            or _rounding_ends(residuals, rounding)
            or _hovers(residuals, asked)
            or near
        ):
            _, ratio = problem.model.elastic_energy(state.positions)
            return Equilibrium(
                iterations=iterations,
                contact=balance.contact,
                elastic_gradient=balance.elastic,
                residual_n=residual,
                min_jacobian=ratio,
                stalled=residual > asked,
            )
        if used_up:
            raise ConvergenceError(
                f"no equilibrium after {iterations} Newton iterations: residual "
                f"{residual:.3g} N at a contact force of {scale:.4g} N",
                remedy="press in smaller steps, or refine the mesh near the indenter's rim",
            )
        problem.move(state, problem.step(state, balance))
        iterations += 1
        logger.debug("iteration %d: residual %.3g N of %.4g N", iterations, residual, scale)


def _rounding_ends(residuals: Sequence[float], rounding_n: float) -> bool:
    """Return whether rounding leaves nothing to gain: as estimated, or near that and seen."""
    last = residuals[-1]
    if last <= rounding_n:
        return True
    recent = residuals[-1 - _STANDSTILL :]
    still = len(recent) > _STANDSTILL and min(recent[1:]) > 0.5 * recent[0]
    return still and last <= _ROUNDING_DOUBT * rounding_n


def _hovers(residuals: Sequence[float], asked_n: float) -> bool:
    """Return whether a residual has stayed just above what was asked for long."""
    recent = residuals[-_HOVERING:]
    return len(recent) == _HOVERING and max(recent) <= _NEAR_ENOUGH * asked_n


def _floor(model: Model, options: NewtonOptions) -> float:
    if options.residual_floor_n is not None:
        return options.residual_floor_n
    return _FLOOR_SHARE * model.young_pa * model.height_m**2


def overlap_fraction(
    model: Model, indenter: Indenter, state: State, tip: FloatArray, motion: FloatArray
) -> float:
    """Return the largest tried fraction of a motion that overlaps no more than allowed.

    Args:
        tip: Where the indenter's tip ends up at fraction one [m]; it moves with the gel.
        motion: Motion of the nodes [m], shape [node_count, 3].
    """
    before = model.gaps(state.positions, indenter, state)
    floor = np.minimum(-OVERLAP_SHARE * model.height_m, before)
    fraction, trial = 1.0, state.copy()
    for _ in range(60):
        trial.tip = state.tip + fraction * (tip - state.tip)
        after = model.gaps(state.positions + fraction * motion, indenter, trial)
        hit = after < floor
        if not hit.any():
            return fraction
        reach = (before - floor)[hit] / np.maximum((before - after)[hit], 1e-300)
        fraction *= min(0.9, float(reach.min()))
    return 0.0
