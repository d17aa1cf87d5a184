"""Case 10: the indenter driven into the gel at speed, and the gel thrown against the indenter."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.mesh.elements import ElementOrder
from sim.solve.dynamics.implicit import DynamicPress, DynamicStep
from sim.solve.dynamics.nodal_mass import inertial_masses
from sim.solve.load_steps.path import LoadingPath
from sim.studies.hard_cases.case import HardCase, Measured, Outcome
from sim.studies.hard_cases.pads import BALL, DENSITY_KG_M3, HEIGHT_M, PUNCH, pad_model, round_mesh

_START_M = -0.01e-3
_STOP_M = 0.4e-3
_SPEEDS_M_S = (1.0, 2.0, 5.0)
_TRAVEL_A_STEP_M = 0.02e-3
_STEP_COUNT = 30
# What Newton's tolerance of 1e-8 of the force leaves in the energies.
_RISE_ALLOWED = 1e-7


def impact() -> Outcome:
    """Follow energies and gaps through every impact."""
    model = pad_model(round_mesh(), order=ElementOrder.P1)
    rise, gap, peak, touching = -np.inf, np.inf, 0.0, 0
    for indenter in (PUNCH, BALL):
        for speed_m_s in _SPEEDS_M_S:
            for follow in (_driven, _thrown):
                steps, gained = follow(LoadingPath(model, indenter), speed_m_s)
                rise = max(rise, float(gained.max()))
                gap = min(gap, *(step.gap_min_m for step in steps))
                force = max(float(step.force_n[2]) for step in steps)
                peak, touching = max(peak, force), touching + (force > 0.0)
    measured: Measured = {
        "impacts": 2 * 2 * len(_SPEEDS_M_S),
        "impacts_that_touched": touching,
        "energy_gain_max_over_impact": rise,
        "gap_min_m": gap,
        "force_max_n": peak,
    }
    passed = touching == measured["impacts"] and rise <= _RISE_ALLOWED and gap > 0.0
    return Outcome(passed=passed, measured=measured)


def _driven(path: LoadingPath, speed_m_s: float) -> tuple[list[DynamicStep], FloatArray]:
    """Drive the indenter in and hold it; return what energy exceeds work by, step by step."""
    press, step_s = _above(path), _TRAVEL_A_STEP_M / speed_m_s
    steps = press.run(
        lambda time_s: min(_START_M + speed_m_s * time_s, _STOP_M),
        step_s=step_s,
        duration_s=_STEP_COUNT * step_s,
    )
    lost = np.array([0.0, *(step.damped_j for step in steps)])
    return steps, -np.diff(lost) / max(step.work_j for step in steps)


def _thrown(path: LoadingPath, speed_m_s: float) -> tuple[list[DynamicStep], FloatArray]:
    """Give the gel a speed towards an indenter that stands still: nothing does any work."""
    press = _above(path)
    shares = path.model.nodes[:, 2] / HEIGHT_M
    press.velocities[:, 2] = speed_m_s * shares
    masses = inertial_masses(path.model, DENSITY_KG_M3)
    thrown_j = 0.5 * path.model.mesh.symmetry.copies * float(masses @ (speed_m_s * shares) ** 2)
    step_s = _TRAVEL_A_STEP_M / speed_m_s
    steps = press.run(lambda _: _START_M, step_s=step_s, duration_s=_STEP_COUNT * step_s)
    energies = [step.elastic_j + step.kinetic_j + step.contact_j for step in steps]
    return steps, np.diff([thrown_j, *energies]) / thrown_j


def _above(path: LoadingPath) -> DynamicPress:
    return DynamicPress(path, density_kg_m3=DENSITY_KG_M3, depth_m=_START_M)


CASES = (
    HardCase(
        number=10,
        name="impact at 1, 2 and 5 m/s",
        criterion="every gap stays positive, and energy does not grow beyond the indenter's work",
        measure=impact,
        limit_s=300.0,
    ),
)
