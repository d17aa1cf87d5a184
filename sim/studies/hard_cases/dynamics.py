"""Cases 6 and 10: time steps that must not matter, and gel and indenter that meet at speed."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.mesh.elements import ElementOrder
from sim.solve.dynamics.implicit import DynamicPress, DynamicStep
from sim.solve.dynamics.weight_and_inertia import INERTIA, nodal_masses
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases.case import Measured, Outcome
from sim.studies.hard_cases.pads import BALL, DENSITY_KG_M3, HEIGHT_M, PUNCH, pad_model, round_mesh

_RAMP_TO_M = 0.4e-3
_RAMP_FROM_M = 0.36e-3
_RAMP_STEPS_S = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
_RAMP_TOLERANCE = 1e-3
# The pad's slowest tone is of about 2 ms.
_RAMP_S = 6e-3
_LISTEN_S = 2e-3
_IMPACT_FROM_M = -0.01e-3
_IMPACT_TO_M = 0.4e-3
_SPEEDS_M_S = (1.0, 2.0, 5.0)
_TRAVEL_A_STEP_M = 0.02e-3
_IMPACT_STEP_COUNT = 30
# What Newton's tolerance of 1e-8 of the force leaves in the energies.
_RISE_ALLOWED = 1e-7


def time_steps() -> Outcome:
    """Press to a depth with every time step, and without time at once."""
    model = pad_model(round_mesh(), order=ElementOrder.P1)
    static = LoadingPath(model, PUNCH).advance(_RAMP_TO_M).force_n[2]
    path = LoadingPath(model, PUNCH, step_max_m=1.0)
    at_once = path.advance(_RAMP_TO_M).force_n[2] / static - 1.0
    measured: Measured = {
        "force_static_n": float(static),
        "at_once_deviation": at_once,
        "at_once_increments": path.counts.increments,
    }
    worst = abs(at_once)
    for step_s in _RAMP_STEPS_S:
        jumped = _jump(model, step_s) / static - 1.0
        even = max((force / static - 1.0 for force in _ramp(model, step_s)), key=abs)
        measured[f"dt_{step_s:g}s_one_step_deviation"] = jumped
        measured[f"dt_{step_s:g}s_even_steps_deviation"] = even
        worst = max(worst, abs(jumped), abs(even))
    measured["deviation_max"] = worst
    return Outcome(passed=worst <= _RAMP_TOLERANCE, measured=measured)


def _jump(model: Model, step_s: float) -> float:
    """Return F_z [N] after the whole depth in one step, then rest in steps that grow."""
    press = _press(LoadingPath(model, PUNCH, step_max_m=1.0))
    found, held_s = press.step(_RAMP_TO_M, step_s), step_s
    while held_s < 1.0:
        held_s *= 4.0
        found = press.step(_RAMP_TO_M, held_s)
    return float(found.force_n[2])


def _ramp(model: Model, step_s: float) -> list[float]:
    """Return F_z [N] for as long as the slowest tone, after a smooth ramp in even steps."""
    path = LoadingPath(model, PUNCH)
    path.advance(_RAMP_FROM_M)
    press, forces, time_s = _press(path), [], 0.0
    while time_s < _RAMP_S + _LISTEN_S:
        time_s += step_s
        share = min(1.0, time_s / _RAMP_S)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        found = press.step(_RAMP_FROM_M + (_RAMP_TO_M - _RAMP_FROM_M) * smooth, step_s)
        if share == 1.0:
            forces.append(float(found.force_n[2]))
    return forces


def _press(path: LoadingPath, *, depth_m: float = 0.0) -> DynamicPress:
    return DynamicPress(path, density_kg_m3=DENSITY_KG_M3, depth_m=depth_m)


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
    press, step_s = _press(path, depth_m=_IMPACT_FROM_M), _TRAVEL_A_STEP_M / speed_m_s
    steps = press.run(
        lambda time_s: min(_IMPACT_FROM_M + speed_m_s * time_s, _IMPACT_TO_M),
        step_s=step_s,
        duration_s=_IMPACT_STEP_COUNT * step_s,
    )
    lost = np.array([0.0, *(step.damped_j for step in steps)])
    return steps, -np.diff(lost) / max(step.work_j for step in steps)


def _thrown(path: LoadingPath, speed_m_s: float) -> tuple[list[DynamicStep], FloatArray]:
    """Give the gel a speed towards an indenter that stands still: nothing does any work."""
    press = _press(path, depth_m=_IMPACT_FROM_M)
    shares = path.model.nodes[:, 2] / HEIGHT_M
    press.velocities[:, 2] = speed_m_s * shares
    masses = nodal_masses(path.model, DENSITY_KG_M3, INERTIA)
    thrown_j = 0.5 * path.model.mesh.symmetry.copies * float(masses @ (speed_m_s * shares) ** 2)
    step_s = _TRAVEL_A_STEP_M / speed_m_s
    steps = press.run(
        lambda _: _IMPACT_FROM_M, step_s=step_s, duration_s=_IMPACT_STEP_COUNT * step_s
    )
    energies = [step.elastic_j + step.kinetic_j + step.contact_j for step in steps]
    return steps, np.diff([thrown_j, *energies]) / thrown_j
