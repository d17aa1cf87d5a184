"""Cases 1, 2 and 15: starts that no press would begin with."""

from __future__ import annotations

import numpy as np

from sim.contact.state import State
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.solve.equilibrium import NEWTON, EquilibriumSolver, Reuse, SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases.pads import (
    HEIGHT_M,
    YOUNG_PA,
    Measured,
    Outcome,
    brick_mesh,
    pad_model,
    quarter_brick_mesh,
)
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError

_FAR = Sphere(diameter_m=1e-2)
_CELLS = (5, 5, 3)
_SEEDS = 3
_ITERATIONS_MAX = 20
# Newton refuses from 30 % of the pad's height, which is 1.2 mm.
_DEPTHS_M = (0.2e-3, 1.1e-3, 1.3e-3, 5e-3)
_PATIENT = SolverOptions(iteration_max=300)
# Energies of the first one's size differ by a few units in their last place when they are equal.
ENERGY_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


def degenerate_starts() -> Outcome:
    """Case 1: every node at one point, on the base, in a plane, or mirrored; P1 and P2.

    The criterion counts Newton's iterations, each with a factor of its own. A press keeps its
    factors, and takes more steps with fewer of them.
    """
    iterations: dict[str, int] = {}
    steps, factors = 0, 0
    worst = 0.0
    for order in ElementOrder:
        model = pad_model(brick_mesh(_CELLS, jitter=0.2), order=order)
        rest = model.nodes
        starts = {
            "to a point": np.tile([0.0, 0.0, 0.5 * HEIGHT_M], (len(rest), 1)),
            "to a point of the base": np.zeros_like(rest),
            "flat on the base": rest * [1.0, 1.0, 0.0],
            "flat across": rest * [0.0, 1.0, 1.0],
            "upside down": rest * [1.0, 1.0, -1.0],
            "mirrored": rest * [-1.0, 1.0, 1.0],
        }
        for name, positions in starts.items():
            for reuse in (NEWTON, Reuse()):
                state = _started(model, positions)
                solver = EquilibriumSolver(model, _FAR, reuse=reuse)
                found = solver.settle(state, options=_PATIENT)
                worst = max(worst, float(np.abs(state.positions - rest).max()) / HEIGHT_M)
                if reuse is NEWTON:
                    iterations[f"{order.value} {name}"] = found.iterations
                else:
                    steps, factors = max(steps, found.iterations), max(factors, solver.factor.made)
    most = max(iterations, key=lambda name: iterations[name])
    measured: Measured = {
        "starts": len(iterations),
        "iterations_max": iterations[most],
        "iterations_max_at": most,
        "steps_with_kept_factors_max": steps,
        "kept_factors_max": factors,
        "distance_from_rest_max_over_height": worst,
    }
    return Outcome(passed=iterations[most] <= _ITERATIONS_MAX and worst <= 1e-6, measured=measured)


def random_start() -> Outcome:
    """Case 2: every free node anywhere in the box; three seeds, P1 and P2, contact far away."""
    rises, residual, iterations = [], 0.0, 0
    knots: list[float] = []
    smallest, inverted = np.inf, 0
    rested = dict.fromkeys(ElementOrder, 0)
    for order in ElementOrder:
        model = pad_model(brick_mesh((4, 4, 2)), order=order)
        for seed in range(_SEEDS):
            state = _started(model, _scattered(model, seed))
            solver = EquilibriumSolver(model, _FAR)
            start = solver.energy_j(state)
            found = solver.settle(state, options=_PATIENT)
            energies = [start, *solver.energies_j]
            iterations = max(iterations, found.iterations)
            rises.append(float(np.diff(energies).max()) / energies[0])
            residual = max(residual, found.residual_n / (YOUNG_PA * HEIGHT_M**2))
            smallest = min(smallest, found.min_jacobian)
            if np.abs(state.positions - model.nodes).max() > 1e-6 * HEIGHT_M:
                knots.append(energies[-1] / model.energy_scale_j)
                inverted = max(inverted, _inverted_count(model, state))
            else:
                rested[order] += 1
    measured: Measured = {
        "starts": len(rises),
        "iterations_max": iterations,
        "energy_rise_max_over_first": max(rises),
        "residual_max_over_E_height2": residual,
        **{f"ended_at_rest_{order.value}": count for order, count in rested.items()},
        "ended_knotted_but_stationary": len(knots),
        "elements_whose_corners_are_inside_out_max": inverted,
        "knot_energy_max_over_E_volume": max(knots, default=0.0),
        "det_F_min_at_the_end": smallest,
    }
    passed = max(rises) <= ENERGY_ROUNDING and residual <= 1e-10 and bool(np.isfinite(smallest))
    return Outcome(passed=passed, measured=measured)


def penetrating_start() -> Outcome:
    """Case 15: the indenter begins inside the undeformed gel, up to a whole diameter deep."""
    model = pad_model(quarter_brick_mesh((4, 4, 4)))
    resolved, worst, gap = 0, 0.0, np.inf
    refusals: dict[str, str] = {}
    spoiled = 0
    for indenter in (Sphere(diameter_m=6e-3), Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)):
        path = LoadingPath(model, indenter)
        for depth_m in _DEPTHS_M:
            state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - depth_m]))
            try:
                found = EquilibriumSolver(model, indenter).settle(state, options=SolverOptions())
            except ConvergenceError as error:
                refusals[f"{depth_m * 1e3:g} mm, {describe(indenter)}"] = error.message
                spoiled += not np.array_equal(state.positions, model.nodes)
                continue
            resolved += 1
            force = model.mesh.symmetry.whole_force(found.contact.forces.sum(axis=(0, 1)))[2]
            worst = max(worst, abs(force / path.advance(depth_m).force_n[2] - 1.0))
            gap = min(gap, float(model.surface.gaps(state.positions, indenter, state).min()))
    measured: Measured = {
        "resolved": resolved,
        "force_deviation_max": worst,
        "gap_min_m": gap,
        "refused": len(refusals),
        "refused_with_the_state_changed": spoiled,
    }
    for where, message in refusals.items():
        measured[f"refused_at {where}"] = message
    passed = resolved > 0 and worst <= 1e-6 and gap > 0.0 and spoiled == 0
    return Outcome(passed=passed, measured=measured)


def _inverted_count(model: Model, state: State) -> int:
    """Return how many tetrahedra have their corners inside out, whatever det F is inside."""
    corners = state.positions[model.elements[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    return int((np.linalg.det(edges) < 0.0).sum())


def _started(model: Model, positions: FloatArray) -> State:
    state = model.rest_state(tip=np.array([0.0, 0.0, 1.0]))
    state.positions = np.where(model.clamped[:, None], model.nodes, positions)
    return state


def _scattered(model: Model, seed: int) -> FloatArray:
    low, high = model.nodes.min(axis=0), model.nodes.max(axis=0)
    return np.random.default_rng(seed).uniform(low, high, size=model.nodes.shape)
