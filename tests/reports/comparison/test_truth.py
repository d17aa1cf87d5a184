"""Truth of a dry run beside what the pipeline made of it."""

from dataclasses import replace

import pytest

from reports.comparison.recovered_truth import recover_truth
from reports.comparison.result_types import ValidationReport
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import EmulatedWorld, RunEvidence
from tacauchy_rig.core.run import Tare
from tacauchy_rig.core.simulated import FoundValue
from tests.made_model import made_model

WORLD = EmulatedWorld(
    values={
        "young_pa": 400e3,
        "pose_error_m": [1.0e-4, -0.6e-4],
        "image_shift_m": [0.4e-4, -0.4e-4],
        "surface_error_m": 2.0e-4,
        "force_noise_n": 0.007,
        "force_drift_n_s": -5e-4,
    },
    surface_expected_m=0.1998,
    dwells={1: (1.25, 1.8e-4)},
)


def tare(fz_n: float, *, start_s: float) -> Tare:
    """Return a tare with 7 mN of noise."""
    start = int(start_s * 1e9)
    return Tare(
        start_ns=start,
        end_ns=start + 10**9,
        mean=(0.0, 0.0, fz_n, 0.0, 0.0, 0.0),
        deviation=(0.0, 0.0, 0.007, 0.0, 0.0, 0.0),
        sample_count=100,
    )


def test_each_quantity_is_recovered(report: ValidationReport, evidence: RunEvidence) -> None:
    """Force, depth, surface, place, modulus, noise and drift stand beside their truth."""
    trials = tuple(
        replace(
            t,
            record=replace(
                t.record, tare_before=tare(0.5, start_s=0.0), tare_after=tare(0.49, start_s=20.0)
            ),
        )
        for t in evidence.trials
        if t.record is not None
    )
    run = replace(evidence, trials=trials, world=WORLD)
    found = {c.name: c for c in recover_truth(run, report.trials)}
    assert found["mean force in the dwell"].true == 1.25
    assert found["mean depth in the dwell"].unit == "mm"
    assert found["height of the gel above the expected"].recovered == pytest.approx(0.2)
    place = found["contact seen off its place along x"]
    assert place.true == pytest.approx(0.14)
    assert place.recovered == pytest.approx(0.032, abs=0.01)
    calibrated = replace(run, model=made_model(image_centre_m=(5e-5, -2e-5)))
    found_there = {c.name: c for c in recover_truth(calibrated, report.trials)}
    for axis, added in (("x", 0.05), ("y", -0.02)):
        name = f"contact seen off its place along {axis}"
        assert found_there[name].recovered == pytest.approx(found[name].recovered + added)
    modulus = found["modulus, from force at the measured depth"]
    assert modulus.recovered == pytest.approx(435.0 / 0.98, rel=0.02)
    assert found["noise of a force sample"].recovered == pytest.approx(7.0)
    assert found["drift of the force sensor"].recovered == pytest.approx(-0.5)


def test_a_lean_stands_beside_its_truth(report: ValidationReport, evidence: RunEvidence) -> None:
    """Whether it was taken or not; what moments did not tell is left out."""
    world = replace(WORLD, values={**WORLD.values, "tilt_rad": [0.017, -0.001]})
    known = FoundValue(
        name="lean towards x", value=0.016, uncertainty=0.002, unit="rad", taken=True, basis=""
    )
    unknown = replace(known, name="lean towards y", value=None, uncertainty=None, taken=False)
    run = replace(evidence, world=world, model=made_model(found=(known, unknown)))
    found = {c.name: c for c in recover_truth(run, report.trials)}
    tilt = found["tilt of the tool towards x"]
    assert (tilt.true, tilt.recovered, tilt.unit) == (17.0, 16.0, "mrad")
    assert "tilt of the tool towards y" not in found


def test_real_run_has_no_truth(evidence: RunEvidence) -> None:
    """Without an emulated world there is nothing to compare with."""
    real = replace(evidence, trials=evidence.trials[:1], simulated=False)
    assert compare(real).truth == ()
