"""Cases 14, 18 and 19: what must hold in every press, and where there is none."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from sim.contact.state import ContactOptions
from sim.mesh.elements import ElementOrder
from sim.press import contact_measures
from sim.solve.load_steps.path import LoadingPath
from sim.studies.hard_cases.case import HardCase, Measured, Outcome
from sim.studies.hard_cases.fingerprint import Fingerprint, fingerprint
from sim.studies.hard_cases.pads import BALL, BARRIER_M, DOMED, PUNCH, pad_model, round_mesh
from sim.studies.hard_cases.rows.friction_slide import balance_relative, slide_and_return

_DEPTH_M = 0.3e-3
# Thousands of terms, each rounded, make a force: 4500 units in its last place.
FORCE_ROUNDING = 1e-12


def no_contact() -> Outcome:
    """Case 14: above the gel, on the way down to it, and after a press."""
    path = LoadingPath(pad_model(round_mesh(pad=DOMED)), PUNCH)
    above = [path.advance(-height) for height in (2e-3, 0.5e-3, 1e-5)]
    iterations = path.counts.newton_iterations
    path.advance(0.1e-3)
    after = path.advance(-0.1e-3)
    forces = [float(np.abs(point.force_n).max()) for point in (*above, after)]
    moved = float(np.abs(after.state.positions - path.model.nodes).max())
    measured: Measured = {
        "force_max_n": max(forces),
        "iterations_before_touch": iterations,
        "left_displaced_m": moved,
    }
    passed = max(forces) == 0.0 and iterations == 0 and moved < 1e-9
    return Outcome(passed=passed, measured=measured)


def force_balance() -> Outcome:
    """Case 18: force balance and gap over shapes, elements and contact laws, and a slide."""
    bonded = ContactOptions(distance_m=BARRIER_M, bonded=True)
    sliding = ContactOptions(distance_m=BARRIER_M, friction=0.4)
    plain = ContactOptions(distance_m=BARRIER_M)
    worst, gap, count = 0.0, np.inf, 0
    for order, indenter, options in (
        (ElementOrder.P1, PUNCH, plain),
        (ElementOrder.P1, BALL, bonded),
        (ElementOrder.P2, PUNCH, plain),
        (ElementOrder.P2, BALL, plain),
        (ElementOrder.P2, PUNCH, bonded),
        (ElementOrder.P2, BALL, sliding),
    ):
        model = pad_model(round_mesh(pad=DOMED), order=order, contact_options=options)
        path = LoadingPath(model, indenter)
        for depth in (0.5 * _DEPTH_M, _DEPTH_M):
            point = path.advance(depth)
            worst = max(worst, balance_relative(model, point))
            gap = min(gap, contact_measures(path, point).gap_min_m)
            count += 1
    slide = slide_and_return()
    worst, gap = max(worst, slide.balance_relative), min(gap, slide.gap_min_m)
    measured: Measured = {
        "equilibria": count + slide.equilibria,
        "force_balance_max_relative": worst,
        "gap_min_m": gap,
        "slide_dissipated_min_of_a_point_j": slide.point_min_j,
        "slide_dissipated_j": slide.dissipated_j,
        "slide_work_less_stored_j": slide.work_less_stored_j,
    }
    passed = worst <= 1e-6 and gap > 0.0
    passed &= slide.gives_nothing_back and min(slide.dissipated_j, slide.work_less_stored_j) > 0.0
    return Outcome(passed=passed, measured=measured)


def repeatable() -> Outcome:
    """Case 19: the same press twice here and once in a process of its own."""
    here, again = fingerprint(), fingerprint()
    command = [sys.executable, "-m", "sim.studies.hard_cases.fingerprint"]
    told = subprocess.run(command, check=True, capture_output=True, text=True)
    force, positions_hash = told.stdout.split()
    there = Fingerprint(force_n=float.fromhex(force), positions_hash=positions_hash)
    measured: Measured = {
        "force_n": here.force_n,
        "deviation_same_process_relative": abs(again.force_n / here.force_n - 1.0),
        "deviation_other_process_relative": abs(there.force_n / here.force_n - 1.0),
        "bitwise_same_process": here == again,
        "bitwise_other_process": here == there,
    }
    apart = max(abs(other.force_n / here.force_n - 1.0) for other in (again, there))
    return Outcome(passed=apart <= FORCE_ROUNDING, measured=measured)


CASES = (
    HardCase(
        number=14,
        name="no contact",
        criterion="exactly zero force in exactly zero iterations",
        measure=no_contact,
        limit_s=300.0,
    ),
    HardCase(
        number=18,
        name="balance of forces, gaps and friction's dissipation",
        criterion="the indenter's force is the base's reaction to 1e-6, every gap is positive, "
        "friction dissipates at least 0",
        measure=force_balance,
        limit_s=300.0,
    ),
    HardCase(
        number=19,
        name="run again",
        criterion="the same result, in this process and in another",
        measure=repeatable,
        limit_s=300.0,
    ),
)
