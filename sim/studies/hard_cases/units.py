"""Case 12: the same press in other units of length and force."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from sim.contact.state import ContactOptions
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import Hold, LoadingPath
from sim.studies.hard_cases.case import Measured, Outcome
from sim.studies.hard_cases.pads import BARRIER_M, YOUNG_PA, pad_model, round_mesh
from tacauchy_rig.core.arrays import FloatArray

_FACTORS = (1e-3, 1e3)
_OPTIONS = SolverOptions(residual_relative=1e-10)
_TOLERANCE = 1e-8
_DEPTH_M, _FORCE_N, _SHIFT_M, _STEP_M = 0.2e-3, 1.0, 0.05e-3, 0.1e-3


def scaled_units() -> Outcome:
    """Press to a depth, push with a force and slide, in five systems of units."""
    expected, _ = _answer(1.0, 1.0)
    worst, at, iterations = 0.0, "", set()
    for length, stress in product(_FACTORS, _FACTORS):
        found, spent = _answer(length, stress)
        iterations.add(spent)
        deviation = max(
            float(np.abs(theirs - mine).max() / np.abs(mine).max())
            for mine, theirs in zip(expected, found, strict=True)
        )
        if deviation >= worst:
            worst, at = deviation, f"length x {length:g}, stress x {stress:g}"
    measured: Measured = {
        "systems_of_units": 1 + len(_FACTORS) ** 2,
        "deviation_max": worst,
        "deviation_max_at": at,
        "iterations_min": min(iterations),
        "iterations_max": max(iterations),
    }
    return Outcome(passed=worst <= _TOLERANCE, measured=measured)


def _answer(length: float, stress: float) -> tuple[tuple[FloatArray, FloatArray], int]:
    """Return what a press gives where the metre is 1/length and the pascal 1/stress as large.

    Positions are over the unit of length, forces over that of force, flat; then the iterations.
    """
    positions, forces, iterations = [], [], 0
    for order, friction in ((ElementOrder.P2, 0.0), (ElementOrder.P1, 0.4)):
        mesh = round_mesh(symmetric=friction == 0.0)
        model = pad_model(
            replace(mesh, vertices=mesh.vertices * length),
            order=order,
            young_pa=YOUNG_PA * stress,
            contact_options=ContactOptions(
                distance_m=BARRIER_M * length, friction=friction, slip_m=1e-6 * length
            ),
        )
        punch = Cylinder(diameter_m=5e-3 * length, fillet_m=0.2e-3 * length)
        path = LoadingPath(model, punch, step_max_m=_STEP_M * length, options=_OPTIONS)
        points = [path.advance(_DEPTH_M * length), path.push(_FORCE_N * stress * length**2)]
        if friction:
            points.append(path.carry(shift_m=(_SHIFT_M * length, 0.0), hold=Hold.FORCE))
        positions += [point.state.positions.reshape(-1) / length for point in points]
        forces += [point.force_n / (stress * length**2) for point in points]
        iterations += path.counts.newton_iterations
    return (np.concatenate(positions), np.concatenate(forces)), iterations
