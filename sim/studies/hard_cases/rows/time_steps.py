"""Case 6: what the time step must not change, and the whole depth in one step."""

from __future__ import annotations

from sim.mesh.elements import ElementOrder
from sim.solve.dynamics.implicit import DynamicPress
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases.case import HardCase, Measured, Outcome
from sim.studies.hard_cases.pads import DENSITY_KG_M3, PUNCH, pad_model, round_mesh

_DEPTH_M = 0.4e-3
_RAMP_FROM_M = 0.36e-3
_STEPS_S = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
_TOLERANCE = 1e-3
# The pad's slowest tone is of about 2 ms.
_RAMP_S = 6e-3
_LISTEN_S = 2e-3


def time_steps() -> Outcome:
    """Press to a depth with every time step, and without time at once."""
    model = pad_model(round_mesh(), order=ElementOrder.P1)
    static = LoadingPath(model, PUNCH).advance(_DEPTH_M).force_n[2]
    path = LoadingPath(model, PUNCH, step_max_m=1.0)
    at_once = path.advance(_DEPTH_M).force_n[2] / static - 1.0
    measured: Measured = {
        "force_static_n": float(static),
        "at_once_deviation": at_once,
        "at_once_increments": path.counts.increments,
    }
    worst = abs(at_once)
    for step_s in _STEPS_S:
        jumped = _jump(model, step_s) / static - 1.0
        even = max((force / static - 1.0 for force in _ramp(model, step_s)), key=abs)
        measured[f"dt_{step_s:g}s_one_step_deviation"] = jumped
        measured[f"dt_{step_s:g}s_even_steps_deviation"] = even
        worst = max(worst, abs(jumped), abs(even))
    measured["deviation_max"] = worst
    return Outcome(passed=worst <= _TOLERANCE, measured=measured)


def _jump(model: Model, step_s: float) -> float:
    """Return F_z [N] after the whole depth in one step, then rest in steps that grow."""
    press = _pressing(LoadingPath(model, PUNCH, step_max_m=1.0))
    found, held_s = press.step(_DEPTH_M, step_s), step_s
    while held_s < 1.0:
        held_s *= 4.0
        found = press.step(_DEPTH_M, held_s)
    return float(found.force_n[2])


def _ramp(model: Model, step_s: float) -> list[float]:
    """Return F_z [N] for as long as the slowest tone, after a smooth ramp in even steps."""
    path = LoadingPath(model, PUNCH)
    path.advance(_RAMP_FROM_M)
    press, forces, time_s = _pressing(path), [], 0.0
    while time_s < _RAMP_S + _LISTEN_S:
        time_s += step_s
        share = min(1.0, time_s / _RAMP_S)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        found = press.step(_RAMP_FROM_M + (_DEPTH_M - _RAMP_FROM_M) * smooth, step_s)
        if share == 1.0:
            forces.append(float(found.force_n[2]))
    return forces


def _pressing(path: LoadingPath) -> DynamicPress:
    return DynamicPress(path, density_kg_m3=DENSITY_KG_M3)


CASES = (
    HardCase(
        number=6,
        name="time step 10 us to 1 s, and the whole depth in one step",
        criterion="the quasi-static F_z is the same to 1e-3",
        measure=time_steps,
        limit_s=300.0,
    ),
)
