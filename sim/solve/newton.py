"""Newton's method for an equilibrium: the indenter held still, or pushed with a given force.

Newton may start with the surfaces slightly overlapping; it ends with every gap positive or not at
all. It ends when the residual, the norm of the unbalanced force, is

- *enough*: at most ``residual_relative`` of the contact force, the floor, or what rounding alone
  leaves of it;
- or *at a standstill that does no harm*: none of the last five iterations brought it below nine
  tenths of what it was before them, and it is at most 3e-7 of the contact force or ten times the
  rounding's estimate. Rounding does that, and a contact point that goes on and off in turn.

At a standstill further up Newton goes on. After ``iteration_max`` iterations a residual that does
no harm is taken, and any other is an error. Where convergence is but linear (the tangent made
semidefinite to the end, a sharp rim half off the pad), Newton goes on while it gains a tenth in
five iterations: what gains less would need more than a hundred for a factor of ten.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.contact.state import ContactForces, State
from sim.solve.model import Model
from sim.solve.overlap import refuse_deep_overlap
from sim.solve.problem import Balance, Problem
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
# The rounding's estimate may be short by this.
_ROUNDING_DOUBT = 10.0
# A standstill: this many iterations leave more than this share of the residual before them.
_WINDOW, _LEFT = 5, 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class NewtonOptions:
    """When Newton stops.

    Attributes:
        residual_relative: Residual norm over the contact force's norm.
        residual_floor_n: Residual norm that is always enough [N], as is the rounding's; None is
            1.5e-11 E H^2 with the pad's height H, so that it scales with the problem.
        iteration_max: Most iterations for one form of the barrier, which ``equilibrate`` relaxes
            where gel stays too near; each form begins to count anew.
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
        stalled: The residual is above what was asked, relative and floor: rounding, a standstill
            or the last iteration ended Newton at one that does no harm.
    """

    iterations: int
    contact: ContactForces
    elastic_gradient: FloatArray
    residual_n: float
    min_jacobian: float
    stalled: bool = False


def equilibrate(problem: Problem, state: State, *, options: NewtonOptions) -> Equilibrium:
    """Move ``state`` to equilibrium; on return the problem's solver holds a recent factor.

    Raises:
        ConvergenceError: No equilibrium was found; ``state`` is left where Newton stopped.
    """
    iterations = _untangle(problem, state)
    refuse_deep_overlap(problem.model, problem.indenter, state)
    contact = problem.model.contact_options
    rough = replace(options, residual_relative=max(options.residual_relative, _ROUGH))
    for extension in (contact.extension, *_EXTENSIONS):
        state.extension = extension
        # Roughly first: where the barrier has to be extended less, the rest would be for nothing.
        for wanted in (rough, options):
            found = _descend(problem, state, options=wanted, spent=iterations)
            iterations = found.iterations
            gaps = problem.model.surface.gaps(state.positions, problem.indenter, state)
            if gaps.min() < contact.gap_least_m(extension):
                break
        else:
            return found
    raise ConvergenceError(
        f"the gel is pressed through the contact barrier: smallest gap {gaps.min() * 1e9:.3g} nm",
        remedy="give the indenter a fillet, coarsen the mesh at its rim, or enlarge the barrier",
    )


def _untangle(problem: Problem, state: State) -> int:
    """Turn a start inside out the right way round, if that lowers the energy; return the solves."""
    model, start = problem.model, state.positions
    if model.gel.energy(start)[1] > 0.0 or inverted_share(model, start) < TANGLED_SHARE:
        return 0
    before, found = problem.energy(state), untangle(model, start)
    state.positions = found.positions
    if problem.energy(state) > before:
        state.positions = start
    logger.debug("untangled in %d passes, %.3g left", found.passes, found.inverted_share)
    return found.passes


def _descend(problem: Problem, state: State, *, options: NewtonOptions, spent: int) -> Equilibrium:
    residuals: list[float] = []
    while True:
        balance = problem.balance(state)
        residuals.append(balance.residual_n)
        iterations = len(residuals) - 1
        if not np.isfinite(residuals[-1]):
            raise ConvergenceError(
                f"the residual is not finite after {iterations} Newton iterations",
                remedy="press in smaller steps or use the stable-neo-hookean law",
            )
        asked = _asked_n(problem.model, balance, options)
        if _ends(residuals, problem.model, balance, asked_n=asked, options=options):
            _, ratio = problem.model.gel.energy(state.positions)
            return Equilibrium(
                iterations=spent + iterations,
                contact=balance.contact,
                elastic_gradient=balance.elastic,
                residual_n=residuals[-1],
                min_jacobian=ratio,
                stalled=residuals[-1] > asked,
            )
        problem.move(state, problem.step(state, balance))
        logger.debug("residual %.3g N of %.4g N", residuals[-1], balance.scale_n)


def _asked_n(model: Model, balance: Balance, options: NewtonOptions) -> float:
    floor = options.residual_floor_n
    if floor is None:
        floor = _FLOOR_SHARE * model.young_pa * model.height_m**2
    return max(options.residual_relative * balance.scale_n, floor)


def _ends(
    residuals: Sequence[float],
    model: Model,
    balance: Balance,
    *,
    asked_n: float,
    options: NewtonOptions,
) -> bool:
    """Apply the rule of this module.

    Args:
        residuals: From the start on [N].
        asked_n: Residual that is enough [N].

    Raises:
        ConvergenceError: The iterations are used up, and the residual would do harm.
    """
    last, rounding = residuals[-1], model.rounding_n(balance.contact)
    if last <= max(asked_n, rounding):
        return True
    harmless = max(_HARMLESS_SHARE * balance.scale_n, _ROUNDING_DOUBT * rounding)
    spent = len(residuals) - 1
    if last <= harmless and (spent >= options.iteration_max or stands_still(residuals)):
        return True
    if spent >= options.iteration_max:
        raise ConvergenceError(
            f"no equilibrium after {spent} Newton iterations: residual "
            f"{last:.3g} N at a contact force of {balance.scale_n:.4g} N",
            remedy="press in smaller steps, or refine the mesh near the indenter's rim",
        )
    return False


def stands_still(residuals: Sequence[float]) -> bool:
    """Return whether the last iterations took less than a tenth off the residual before them."""
    recent = residuals[-_WINDOW:]
    return len(residuals) > _WINDOW and min(recent) > _LEFT * residuals[-1 - _WINDOW]
