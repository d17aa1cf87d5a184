"""Slow faults of force sensor and arm in simulated time, in small."""

from dataclasses import replace
from functools import cache

import pytest

from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.force_sensor_gain import judge_forces
from tacauchy_rig.core.run import Outcome, TrialRecord
from tests.protocols.conftest import NEAR, fresh_plan
from tests.studies.force_faults.command import HONEST, pressed, tables_of
from tests.studies.force_faults.runner import press
from tests.studies.force_faults.worlds import (
    EXPECTED,
    TRIALS,
    Fault,
    Kind,
    MiniGel,
    Place,
    faulty_world,
    honest_world,
)


def of(model, seed=1):
    """Return the first honest world from a seed on whose arm is a model."""
    return next(w for w in map(honest_world, range(seed, seed + 50)) if w.model is model)


@cache
def honest(model):
    """Return what became of an honest world."""
    return pressed((HONEST, of(model)))


@pytest.mark.parametrize("model", list(RobotModel))
def test_an_honest_world_passes_and_its_errors_are_within_what_is_stated(model):
    """All six trials, on either arm."""
    found = honest(model)
    assert not found.reason
    assert found.passed == TRIALS
    assert found.beyond < 0.0
    assert found.above_n < 0.0


@pytest.mark.parametrize("model", list(RobotModel))
def test_a_gain_that_sinks_by_a_quarter_over_the_run_leaves_no_trial_safe(model):
    """By less than the guard sees from one press to the next."""
    sinking = Fault(kind=Kind.RAMP, size=0.25, trial=1)
    run = press(replace(of(model), sensor=sinking))
    assert run.is_doubted
    assert not run.passed


def test_a_gain_that_falls_in_the_last_trial_of_a_coarse_arm_is_found_by_the_weight():
    """After the dwell nothing else would tell."""
    late = Fault(kind=Kind.STEP, size=0.2, trial=6, moment=0.9)
    run = press(replace(of(RobotModel.CB3), sensor=late))
    assert run.is_doubted
    assert run.reason.startswith("weight: ")
    assert len(run.records) == TRIALS
    assert not judge_forces(run.records, RobotModel.CB3).fault


def test_the_tables_name_what_failed():
    """A trial that passes with a wrong force is a failure, by its seed."""
    whole = honest(RobotModel.E_SERIES)
    found = pressed((Place.SENSOR.value, faulty_world(3, Place.SENSOR)))
    assert all(table.passed for table in tables_of([whole, found]))
    bad = replace(found, beyond=0.3, passed=6)
    honest_table, faulty_table, _, failures = tables_of([whole, bad])
    assert honest_table.passed
    assert not faulty_table.passed
    assert failures.rows[0][0] == bad.world.seed
    rejected = [replace(whole, passed=0)] * 2
    assert not tables_of([*rejected, *[whole] * 198])[0].passed


def test_a_trial_that_contradicts_earlier_ones_ends_the_run_and_keeps_none_of_them(laboratory):
    """An earlier session's trial was measured by a sensor that read seven tenths of the force."""
    lab = laboratory(
        'protocol.force_targets=["1.2556 N", "1.9511 N", "2.6466 N"]',
        *NEAR,
        'protocol.tare_duration="0.4 s"',
        expected=EXPECTED,
        gel=MiniGel(),
    )
    wrong = TrialRecord(
        index=1,
        attempt=1,
        outcome=Outcome.PASSED,
        force_target_n=1.2556,
        force_measured_n=1.2556,
        arm_force_n=1.2556 / 0.7,
        depth_measured_m=0.31e-3,
        force_expected_n=(1.0, 2.4),
    )
    first, second, third = fresh_plan(lab.config)
    plan = (replace(first, done=True, record=wrong), second, third)
    result = lab.run(plan)
    assert result.outcome is Outcome.FAULT
    assert "gain changed by +" in result.reason
    assert result.reason.endswith("Trial 1 is in doubt as well: the same sensor measured it.")
    assert "--check-weight" in result.remedy
    (record,) = result.records
    assert record.reason == "missed: force_history"
    assert len(record.press_depth_m) > 10
