"""Cases 1, 2, 12, 14, 15, 18, 19: odd starts, other units, no contact, balance, repetition."""

import hashlib
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from sim.contact.surface_and_grip import State
from sim.fields.pressure_and_shear import contact_measures
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.solve.equilibrium import NEWTON, EquilibriumSolver, Reuse, SolverOptions
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.hard_cases import small_pads
from sim.studies.hard_cases.small_pads import Measured
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError
from tacauchy_rig.core.parallel import IsolatedWorker

_FAR = Sphere(diameter_m=1e-2)
_CELLS = (5, 5, 3)
_SEEDS, _SHUFFLED = 3, (1.0, 0.05)
# Newton refuses from 30 % of the pad's height, which is 1.2 mm.
_DEPTHS_M = (0.2e-3, 1.1e-3, 1.3e-3, 5e-3)
_PATIENT = SolverOptions(iteration_max=300)


def degenerate_starts() -> Measured:
    """Case 1: every node at one point, on the base, in a plane, or mirrored; P1 and P2."""
    iterations, worst = list[int](), 0.0
    for order in ElementOrder:
        model = small_pads.pad_model(small_pads.brick_mesh(_CELLS, jitter=0.2), order=order)
        rest = model.nodes
        starts = (
            np.tile([0.0, 0.0, 0.5 * small_pads.HEIGHT_M], (len(rest), 1)),  # to a point
            np.zeros_like(rest),  # to one of the base
            *(rest * by for by in ([1.0, 1.0, 0.0], [0.0, 1.0, 1.0])),  # flat
            *(rest * by for by in ([1.0, 1.0, -1.0], [-1.0, 1.0, 1.0])),  # mirrored
        )
        for positions, reuse in product(starts, (NEWTON, Reuse())):
            state = _started(model, positions)
            solver = EquilibriumSolver(model, _FAR, reuse=reuse)
            found = solver.settle(state, options=_PATIENT)
            worst = max(worst, float(np.abs(state.positions - rest).max()) / small_pads.HEIGHT_M)
            iterations.append(found.iterations)
    return {
        "starts": len(iterations),
        "iterations_max": max(iterations),
        "distance_from_rest_max_over_height": worst,
    }


def random_start() -> Measured:
    """Case 2: every free node anywhere in the box, or shuffled by a share of that; no contact.

    Three seeds each, P1 and P2. What is anywhere begins at rest; what is shuffled descends.
    """
    rises, residual, iterations, knots = [], 0.0, 0, list[float]()
    smallest, inverted = np.inf, 0
    rested = dict.fromkeys(ElementOrder, 0)
    for order in ElementOrder:
        model = small_pads.pad_model(small_pads.brick_mesh((4, 4, 2)), order=order)
        for seed, share in product(range(_SEEDS), _SHUFFLED):
            low, high = model.nodes.min(axis=0), model.nodes.max(axis=0)
            anywhere = np.random.default_rng(seed).uniform(low, high, size=model.nodes.shape)
            state = _started(model, model.nodes + share * (anywhere - model.nodes))
            solver = EquilibriumSolver(model, _FAR)
            start = small_pads.stored_j(model, _FAR, state)
            found = solver.settle(state, options=_PATIENT)
            energies = [start, *solver.energies_j, small_pads.stored_j(model, _FAR, state)]
            iterations = max(iterations, found.iterations)
            rises.append(float(np.diff(energies).max()) / energies[0])
            residual = max(
                residual, found.residual_n / (small_pads.YOUNG_PA * small_pads.HEIGHT_M**2)
            )
            smallest = min(smallest, found.min_jacobian)
            if np.abs(state.positions - model.nodes).max() > 1e-6 * small_pads.HEIGHT_M:
                knots.append(energies[-1] / model.energy_scale_j)
                # Corners inside out, whatever det F is inside.
                corners = state.positions[model.elements[:, :4]]
                turned = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
                inverted = max(inverted, int(turned.sum()))
            else:
                rested[order] += 1
    return {
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


def penetrating_start() -> Measured:
    """Case 15: the indenter begins inside the undeformed gel, up to a whole diameter deep."""
    model = small_pads.pad_model(small_pads.brick_mesh((4, 4, 4), quarter=True))
    resolved, worst, gap, spoiled = 0, 0.0, np.inf, 0
    refusals: dict[str, str] = {}
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
    return {
        "resolved": resolved,
        "force_deviation_max": worst,
        "gap_min_m": gap,
        "refused": len(refusals),
        "refused_with_the_state_changed": spoiled,
        **{f"refused_at {where}": message for where, message in refusals.items()},
    }


def _started(model: Model, positions: FloatArray) -> State:
    state = model.rest_state(tip=np.array([0.0, 0.0, 1.0]))
    state.positions = np.where(model.clamped[:, None], model.nodes, positions)
    return state


_DEPTH_M = 0.3e-3
# For a press in another process, its start and the loading of its kernels included.
_OTHER_LIMIT_S = 250.0
_SLIDE_STEP_M = 0.05e-3
_SLIDE_SIGNS = (1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0)


def no_contact() -> Measured:
    """Case 14: above the gel, on the way down to it, and after a press."""
    path = LoadingPath(
        small_pads.pad_model(small_pads.round_mesh(pad=small_pads.DOMED)), small_pads.PUNCH
    )
    above = [path.advance(-height) for height in (2e-3, 0.5e-3, 1e-5)]
    iterations = path.counts.newton_iterations
    path.advance(0.1e-3)
    after = path.advance(-0.1e-3)
    return {
        "force_max_n": max(float(np.abs(point.force_n).max()) for point in (*above, after)),
        "iterations_before_touch": iterations,
        "left_displaced_m": float(np.abs(after.state.positions - path.model.nodes).max()),
    }


def force_balance() -> Measured:
    """Case 18: force balance and gap over shapes, elements and contact laws, and a slide."""
    plain, bonded, sliding = dict[str, Any](), {"bonded": True}, {"friction": 0.4}
    worst, gap, count = 0.0, np.inf, 0
    for order, indenter, contact in (
        (ElementOrder.P1, small_pads.PUNCH, plain),
        (ElementOrder.P1, small_pads.BALL, bonded),
        (ElementOrder.P2, small_pads.PUNCH, plain),
        (ElementOrder.P2, small_pads.BALL, plain),
        (ElementOrder.P2, small_pads.PUNCH, bonded),
        (ElementOrder.P2, small_pads.BALL, sliding),
    ):
        model = small_pads.pad_model(
            small_pads.round_mesh(pad=small_pads.DOMED), order=order, **contact
        )
        path = LoadingPath(model, indenter)
        for depth in (0.5 * _DEPTH_M, _DEPTH_M):
            point = path.advance(depth)
            worst = max(worst, small_pads.balance_relative(model, point))
            gap = min(gap, contact_measures(model, point).gap_min_m)
            count += 1
    slide = slide_and_return()
    return {
        "equilibria": count + len(_SLIDE_SIGNS),
        "force_balance_max_relative": max(worst, slide["balance_relative"]),
        "gap_min_m": min(gap, slide["gap_min_m"]),
        "slide_dissipated_min_of_a_point_j": slide["point_min_j"],
        "slide_dissipated_min_of_a_point_relative": slide["point_min_j"] / slide["dissipated_j"],
        "slide_dissipated_j": slide["dissipated_j"],
        "slide_work_less_stored_j": slide["work_less_stored_j"],
    }


def repeatable() -> Measured:
    """Case 19: the same press twice here and once in a process of its own."""
    with IsolatedWorker() as process:
        there = process.call(fingerprint, limit_s=_OTHER_LIMIT_S)
    here, again = fingerprint(), fingerprint()
    force, *others = (float.fromhex(found.split()[0]) for found in (here, again, there))
    same, other = (abs(found / force - 1.0) for found in others)
    return {
        "force_n": force,
        "deviation_same_process_relative": same,
        "deviation_other_process_relative": other,
        "bitwise_same_process": here == again,
        "bitwise_other_process": here == there,
    }


def slide_and_return() -> dict[str, float]:
    """Press a ball in, slide it by 0.2 mm and back at the same depth.

    Returns:
        The largest imbalance, relative; the smallest gap [m]; the least dissipation of a contact
        point in an increment, and the sum of friction's force times slip [J]; the indenter's work
        by the trapezoidal rule less what is stored [J].
    """
    model = small_pads.pad_model(
        small_pads.round_mesh(symmetric=False), order=ElementOrder.P1, friction=0.4
    )
    path = LoadingPath(model, small_pads.BALL, step_max_m=_SLIDE_STEP_M)
    point = path.advance(_DEPTH_M)
    stored, work = small_pads.stored_j(model, path.indenter, point.state), 0.0
    balances, gaps, lost = [], [], []
    for sign in _SLIDE_SIGNS:
        before = point
        point = path.carry(shift_m=(sign * _SLIDE_STEP_M, 0.0), hold=Hold.DEPTH)
        travel = point.state.tip - before.state.tip
        work -= 0.5 * float((before.force_n + point.force_n) @ travel)
        lost.append(_dissipation(before, point))
        balances.append(small_pads.balance_relative(model, point))
        gaps.append(contact_measures(path.model, point).gap_min_m)
    return {
        "balance_relative": max(balances),
        "gap_min_m": min(gaps),
        "point_min_j": min(least for least, _ in lost),
        "dissipated_j": sum(total for _, total in lost),
        "work_less_stored_j": work
        - (small_pads.stored_j(model, path.indenter, point.state) - stored),
    }


def _dissipation(before: PathPoint, after: PathPoint) -> tuple[float, float]:
    """Return the least and the summed tangential force times slip of points that held on [J]."""
    earlier, later = small_pads.grip_of(before), small_pads.grip_of(after)
    both = (earlier.held > 0.0) & (later.held > 0.0)
    loads = later.loads[both]
    normals = loads / np.linalg.norm(loads, axis=1, keepdims=True)
    forces = after.equilibrium.contact.forces[both] @ after.state.rotation
    tangential = forces - np.sum(forces * normals, axis=1, keepdims=True) * normals
    lost = np.sum(tangential * (later.anchors[both] - earlier.anchors[both]), axis=1)
    return float(lost.min()), float(lost.sum())


def fingerprint() -> str:
    """Press a filleted cylinder into a domed pad; return F_z [N] and a hash of all positions.

    They are equal for bitwise equal results.
    """
    path = LoadingPath(
        small_pads.pad_model(small_pads.round_mesh(pad=small_pads.DOMED)), small_pads.PUNCH
    )
    point = path.advance(0.2e-3)
    digest = hashlib.sha256(point.state.positions.tobytes()).hexdigest()
    return f"{float(point.force_n[2]).hex()} {digest}"


_FACTORS = (1e-3, 1e3)
_OPTIONS = SolverOptions(residual_relative=1e-10)
_UNITS_DEPTH_M, _FORCE_N, _SHIFT_M, _STEP_M = 0.2e-3, 1.0, 0.05e-3, 0.1e-3


def scaled_units() -> Measured:
    """Press to a depth, push with a force and slide, in five systems of units."""
    expected, _ = _answer(1.0, 1.0)
    worst, at, iterations = 0.0, "", set()
    for length, stress in product(_FACTORS, _FACTORS):
        found, spent = _answer(length, stress)
        iterations.add(spent)
        pairs = zip(expected, found, strict=True)
        deviation = max(float(np.abs(b - a).max() / np.abs(a).max()) for a, b in pairs)
        if deviation >= worst:
            worst, at = deviation, f"length x {length:g}, stress x {stress:g}"
    return {
        "systems_of_units": 1 + len(_FACTORS) ** 2,
        "deviation_max": worst,
        "deviation_max_at": at,
        "iterations_min": min(iterations),
        "iterations_max": max(iterations),
    }


def _answer(length: float, stress: float) -> tuple[tuple[FloatArray, FloatArray], int]:
    """Return what a press gives where the metre is 1/length and the pascal 1/stress as large.

    Positions are over the unit of length, forces over that of force, flat; then the iterations.
    """
    positions, forces, iterations = [], [], 0
    for order, friction in ((ElementOrder.P2, 0.0), (ElementOrder.P1, 0.4)):
        mesh = small_pads.round_mesh(symmetric=friction == 0.0)
        model = small_pads.pad_model(
            replace(mesh, vertices=mesh.vertices * length),
            order=order,
            young_pa=small_pads.YOUNG_PA * stress,
            distance_m=small_pads.BARRIER_M * length,
            friction=friction,
            slip_m=1e-6 * length,
        )
        punch = Cylinder(diameter_m=5e-3 * length, fillet_m=0.2e-3 * length)
        path = LoadingPath(model, punch, step_max_m=_STEP_M * length, options=_OPTIONS)
        points = [path.advance(_UNITS_DEPTH_M * length), path.push(_FORCE_N * stress * length**2)]
        if friction:
            points.append(path.carry(shift_m=(_SHIFT_M * length, 0.0), hold=Hold.FORCE))
        positions += [point.state.positions.reshape(-1) / length for point in points]
        forces += [point.force_n / (stress * length**2) for point in points]
        iterations += path.counts.newton_iterations
    return (np.concatenate(positions), np.concatenate(forces)), iterations
