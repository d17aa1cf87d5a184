"""Newton's method for a static equilibrium with the indenter held still.

Each iteration factors the exact Hessian; only when that is not positive definite, or an element is
inverted, is it replaced by a semidefinite one. The line search limits overlap and lowers the
energy. Newton may start with the surfaces slightly overlapping; it ends with every gap positive or
not at all.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.indenter import Indenter
from sim.linear_solver import LinearSolver, NotPositiveDefiniteError
from sim.model import Model
from sim.state import ContactForces, State
from tacauchy_rig.errors import ConvergenceError

logger = logging.getLogger(__name__)

OVERLAP_MAX_M = 2e-5
_EXTENSIONS = (0.5, 0.25, 0.1, 0.03, 0.01, 0.003, 0.001)
_SLOPE_LEFT = 0.3
_SHIFTS = (0.0, 1e-3, 1e-1)


@dataclass(frozen=True, slots=True, kw_only=True)
class NewtonOptions:
    """When Newton stops.

    Attributes:
        residual_relative: Residual norm over the contact force's norm.
        residual_floor_n: Residual norm that is always enough [N].
    """

    residual_relative: float = 1e-8
    residual_floor_n: float = 1e-10
    iteration_max: int = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A converged state's numbers.

    Attributes:
        iterations: Factorisations spent.
        contact: Contact forces at the last positions.
        elastic_gradient: Gradient of the elastic energy [N], shape [node_count, 3].
        residual_n: Norm of the unbalanced nodal force [N].
    """

    iterations: int
    contact: ContactForces
    elastic_gradient: FloatArray
    residual_n: float
    min_jacobian: float


def equilibrate(
    model: Model,
    solver: LinearSolver,
    indenter: Indenter,
    state: State,
    *,
    options: NewtonOptions,
) -> Equilibrium:
    """Move ``state.positions`` to equilibrium; on return ``solver`` holds a recent factor.

    Raises:
        ConvergenceError: No equilibrium was found; ``state`` is left where Newton stopped.
    """
    iterations = 0
    state.extension = _EXTENSIONS[0]
    for extension in _EXTENSIONS:
        state.extension = extension
        found = _solve(model, solver, indenter, state, options=options, spent=iterations)
        iterations = found.iterations
        gaps = model.gaps(state.positions, indenter, state)
        if gaps.min() >= extension * model.contact_options.distance_m:
            return found
    raise ConvergenceError(
        f"the gel is pressed through the contact barrier: smallest gap {gaps.min() * 1e9:.3g} nm",
        remedy="give the indenter a fillet, coarsen the mesh at its rim, or enlarge the barrier",
    )


def _solve(
    model: Model,
    solver: LinearSolver,
    indenter: Indenter,
    state: State,
    *,
    options: NewtonOptions,
    spent: int,
) -> Equilibrium:
    iterations = spent
    while True:
        forces = model.contact_forces(state.positions, indenter, state)
        elastic = model.elastic_gradient(state.positions)
        gradient = model.pattern.unknowns(elastic + model.scatter(forces.forces))
        residual = float(np.linalg.norm(gradient))
        scale = float(np.linalg.norm(forces.forces.reshape(-1, 3).sum(axis=0)))
        if not np.isfinite(residual):
            raise ConvergenceError(
                f"the residual is not finite after {iterations} Newton iterations",
                remedy="press in smaller steps or use the stable-neo-hookean law",
            )
        if residual <= max(options.residual_relative * scale, options.residual_floor_n):
            _, ratio = model.elastic_energy(state.positions)
            return Equilibrium(
                iterations=iterations,
                contact=forces,
                elastic_gradient=elastic,
                residual_n=residual,
                min_jacobian=ratio,
            )
        if iterations >= options.iteration_max:
            raise ConvergenceError(
                f"no equilibrium after {iterations} Newton iterations: residual "
                f"{residual:.3g} N at a contact force of {scale:.4g} N",
                remedy="press in smaller steps, or refine the mesh near the indenter's rim",
            )
        step = _newton_step(model, solver, indenter, state, forces, gradient)
        iterations += 1
        fraction = _search(model, indenter, state, step, gradient)
        logger.debug(
            "iteration %d: residual %.3g N, force %.4g N, step %.2g",
            iterations,
            residual,
            scale,
            fraction,
        )


def _newton_step(
    model: Model,
    solver: LinearSolver,
    indenter: Indenter,
    state: State,
    forces: ContactForces,
    gradient: FloatArray,
) -> FloatArray:
    """Return the Newton step of the unknowns [m], shape [dof_count]."""
    x = state.positions
    for attempt, shift in enumerate((0.0, *_SHIFTS)):
        if attempt == 1:
            forces = model.contact_forces(x, indenter, state, curved=False)
        data = model.hessian_data(x, forces.stiffness, projected=attempt > 0)
        data[model.pattern.indptr[:-1]] *= 1.0 + shift
        try:
            solver.factorise(data)
        except NotPositiveDefiniteError:
            logger.debug("Hessian not positive definite (attempt %d)", attempt)
            continue
        return -solver.solve(gradient)
    raise ConvergenceError(
        "the stiffness matrix is not positive definite even when projected and shifted",
        remedy="the mesh has degenerate tetrahedra or lost its clamped base: check it",
    )


def _search(
    model: Model, indenter: Indenter, state: State, step: FloatArray, gradient: FloatArray
) -> float:
    """Move ``state.positions`` along the step as far as overlap and energy allow."""
    full = model.pattern.nodal(step)
    start = state.positions
    slope = float(gradient @ step)
    fraction = overlap_fraction(model, indenter, state, state.tip, full)
    energy = model.elastic_energy(start)[0] + model.contact_energy(start, indenter, state)
    # Rounding of the summed energy: below it only the gradient can tell which way is down.
    noise = 1e-12 * abs(energy) + 1e-15 * model.young_pa * model.volume_m3
    for _ in range(40):
        state.positions = start + fraction * full
        elastic, _ = model.elastic_energy(state.positions)
        change = elastic + model.contact_energy(state.positions, indenter, state) - energy
        if abs(change) <= noise:
            forces = model.contact_forces(state.positions, indenter, state).forces
            elastic_gradient = model.elastic_gradient(state.positions)
            ahead = float(model.pattern.unknowns(elastic_gradient + model.scatter(forces)) @ step)
            if ahead <= _SLOPE_LEFT * abs(slope):
                return fraction
            fraction *= max(0.1, abs(slope) / (abs(slope) + ahead))
        elif change <= 1e-4 * fraction * slope:
            return fraction
        else:
            fraction *= 0.5
    state.positions = start
    raise ConvergenceError(
        f"the line search found no descent along a direction of slope {slope:.3g} J",
        remedy="press in smaller steps",
    )


def overlap_fraction(
    model: Model, indenter: Indenter, state: State, tip: FloatArray, motion: FloatArray
) -> float:
    """Return the largest tried fraction of a motion that overlaps no more than allowed.

    Args:
        tip: Where the indenter's tip ends up at fraction one [m]; it moves with the gel.
        motion: Motion of the nodes [m], shape [node_count, 3].
    """
    before = model.gaps(state.positions, indenter, state)
    floor = np.minimum(-OVERLAP_MAX_M, before)
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
