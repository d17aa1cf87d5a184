"""Each term of a force's budget is what its source says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from reports.evidence.evidence import RunEvidence
from reports.scores.force_agreement import Scatter, UncertaintyTerm, scatter_of, uncertainty_budget
from tacauchy_rig.core.config.uncertainty import Stated
from tacauchy_rig.core.simulated import ForceInput
from tests.made_model import made_model

STATED = {
    name: Stated(value=value, source="made up")
    for name, value in {
        "depth": 20e-6,
        "delay": 0.03,
        "force_scale": 0.01,
        "search_speed": 1e-4,
        "contact_force": 0.05,
    }.items()
}
SCATTER = Scatter(relative=0.002, degrees_of_freedom=4.0, basis="made up")


def _terms(evidence: RunEvidence, **changes: object) -> dict[str, UncertaintyTerm]:
    trial = evidence.trials[2]
    assert trial.record is not None
    record = replace(trial.record, force_rate_n_s=-0.1, force_drift_n=-0.03)
    tilt = ForceInput(name="tilt", basis="tried", depths_m=(1e-4, 5e-4), changes=(0.10, 0.02))
    asked = {
        "predicted_n": 2.0,
        "touched_m": 1e-5,
        "scatter": SCATTER,
        "stated": STATED,
        **changes,
    }
    model = made_model(young_uncertainty_relative=0.05, force_inputs=(tilt,))
    budget = uncertainty_budget(replace(trial, record=record), model, **asked)  # type: ignore[arg-type]
    return {term.name: term for term in budget}


def test_terms_by_hand(evidence: RunEvidence) -> None:
    """Shares of 2 N, 1 % of what a cell read, a drift that is uniform, a delay times a rate."""
    trial, found = evidence.trials[2], _terms(evidence)
    assert trial.record is not None
    assert trial.record.depth_measured_m is not None
    between = np.interp(trial.record.depth_measured_m, (1e-4, 5e-4), (0.10, 0.02))
    wanted = {
        "modulus of the gel": 0.1,
        "tilt": 2.0 * between,
        "calibration of the force cell": 0.01 * (trial.record.force_measured_n or 0.0),
        "drift of the force cell's zero": 0.03 / math.sqrt(3.0),
        "synchrony of force and height": 0.003,
        "repeatability of the press": 0.004,
        "light of the image": 0.0,
    }
    for name, value in wanted.items():
        assert found[name].value_n == pytest.approx(value), name
    assert found["repeatability of the press"].degrees_of_freedom == 4.0
    assert all(term.value_n is not None for term in found.values())


def test_height_of_contact_is_arm_delay_and_half_of_the_touch(evidence: RunEvidence) -> None:
    """20 um of the arm, 3 um of the way in 30 ms, 5 um of 10, on 7.07 kN/m; no tare, no noise."""
    found = _terms(evidence)["height of first contact"]
    assert found.value_n == pytest.approx(7070.0 * math.hypot(20e-6, 3e-6, 5e-6), rel=1e-3)


def test_what_is_not_stated_stays_unknown(evidence: RunEvidence) -> None:
    """Neither heights of the arm, nor a calibration, nor a repeatability is made up."""
    few = scatter_of([(1.0, 1.0, 1.0)] * 2)
    found = _terms(evidence, stated={}, scatter=few)
    unknown = {name for name, term in found.items() if term.value_n is None}
    assert unknown == {
        "height of first contact",
        "calibration of the force cell",
        "synchrony of force and height",
        "repeatability of the press",
    }
    assert all(found[name].basis.startswith("unknown") for name in unknown)


def test_repeats_tell_the_scatter_of_a_press() -> None:
    """Five presses of one force that scatter by 2 %, whatever other forces are off by."""
    off = (0.98, 0.98, 1.0, 1.02, 1.02)
    presses = [(2.0, 2.0 * by, 2.0) for by in off] + [(4.0, 6.0, 4.0)]
    found = scatter_of(presses)
    assert found.degrees_of_freedom == 4.0
    assert found.relative == pytest.approx(float(np.std(off, ddof=1)))


def test_without_repeats_a_line_over_the_force_is_no_scatter() -> None:
    """A ratio that falls with the force is a wrong model, not presses that differ."""
    forces = np.linspace(1.0, 5.0, 6)
    ratios = 1.1 - 0.03 * forces
    line = [(f, f * by, f) for f, by in zip(forces, ratios, strict=True)]
    found = scatter_of(line)
    assert found.degrees_of_freedom == 4.0
    assert found.relative == pytest.approx(0.0, abs=1e-9)
    ratios[3] += 0.02
    assert scatter_of(
        [(f, f * by, f) for f, by in zip(forces, ratios, strict=True)]
    ).relative == pytest.approx(0.02 / 2.0, rel=0.25)
