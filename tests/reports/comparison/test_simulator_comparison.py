"""Simulators side by side on a made-up run: who is better is known beforehand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from reports.comparison.result_types import ValidationReport
from reports.comparison.simulator_comparison import Judgement, contests, judge
from reports.evidence.evidence_types import RunEvidence
from tacauchy_rig.core.simulated import Driven, Outputs, PressOutput, Simulator
from tests.reports.replay_outputs import replay_outputs

HEIGHT_M, PRESSURE_PA = -1.0e-4, 2.0e3
WEAK = 0.7  # of the contact's change


@pytest.fixture(scope="module")
def two(evidence: RunEvidence) -> RunEvidence:
    """The first and the last trial: fewer are faster."""
    return replace(evidence, trials=(evidence.trials[0], evidence.trials[5]))


def _others(evidence: RunEvidence, made: SimpleNamespace, *, force: float, part: float) -> Outputs:
    """Return what shows a part of each press's change, and a part of its force."""
    presses = {}
    for trial in evidence.trials:
        reference = trial.images.reference.astype(np.float64)
        image = made.to_image(reference + part * (trial.simulated_image - reference))
        shape = image.shape[:2]
        presses[trial.index] = PressOutput(
            image=image,
            force_n=force * trial.record.force_measured_n,
            height_m=np.full(shape, HEIGHT_M),
            pressure_pa=np.full(shape, PRESSURE_PA),
            shear_pa=np.full((*shape, 2), (PRESSURE_PA, 0.0)),
        )
    who = Simulator(name="Other", version="2", driven_by=Driven.DEPTH)
    return Outputs(simulator=who, presses=presses)


@pytest.fixture(scope="module")
def judged(two: RunEvidence, made: SimpleNamespace) -> Judgement:
    """Ours and another that shows too weak a contact and twice the force."""
    shape = two.trials[0].images.real.shape[:2]
    heights = {trial.index: np.zeros(shape) for trial in two.trials}
    pressures = {trial.index: np.full(shape, 2.0 * PRESSURE_PA) for trial in two.trials}
    shears = {trial.index: np.full((*shape, 2), (0.0, PRESSURE_PA)) for trial in two.trials}
    ours = replay_outputs(two, heights, pressures, shears)
    return judge(two, [_others(two, made, force=2.0, part=WEAK)], ours=ours)


def test_ours_stands_first_and_scores_as_in_its_report(
    judged: Judgement, report: ValidationReport
) -> None:
    """The replay's scores are those of the run's own report, to the last digit."""
    ours = judged.simulators[0]
    assert ours.is_ours
    by_index = {trial.index: trial for trial in report.trials}
    for press in ours.presses:
        assert press.metrics == by_index[press.index].metrics
        assert press.contact == by_index[press.index].contact
        assert press.force_error_n == by_index[press.index].force.prediction_error_n


def test_a_weak_contact_loses_and_says_by_how_much(judged: Judgement) -> None:
    """What shows 0.7 of the change leaves more of it; twice the force is off by 100 %."""
    ours, other = judged.simulators
    assert (
        other.means["contact_relative_residual"].mean > ours.means["contact_relative_residual"].mean
    )
    assert other.means["force_error_relative"].mean == pytest.approx(1.0)
    by_score = {c.score.key: c for c in contests(judged)}
    assert not by_score["contact_relative_residual"].is_lost
    assert by_score["force_error_relative"].difference.mean > 90.0  # per cent
    for simulator in judged.simulators:
        for press in simulator.presses:
            rival = press.value("contact_residual_of_rival")
            assert (rival > press.contact.relative_residual) == press.wins
    assert "height_apart_rms_m" not in by_score  # apart from ours: no error


def test_ours_can_lose(two: RunEvidence) -> None:
    """Where the other shows the very camera's image, ours loses every score and it is said."""
    seen = {t.index: PressOutput(image=t.images.real) for t in two.trials}
    perfect = Outputs(simulator=Simulator(name="Camera", version="1"), presses=seen)
    ours = replay_outputs(two)
    found = contests(judge(two, [perfect], ours=ours))
    assert {c.score.key for c in found} >= {"ssim", "contact_relative_residual"}
    assert all(c.is_lost for c in found if c.score.key != "psnr_db")


def test_floors_and_ceiling_are_the_reports(judged: Judgement) -> None:
    """No contact leaves a residual of 1, and the ceiling is what two halves of a dwell reach."""
    bare, flat = judged.floors
    assert bare.means["contact_relative_residual"].mean == 1.0
    assert flat.means["ssim"].mean < bare.means["ssim"].mean
    assert judged.ceiling.name.startswith("noise")
    assert judged.ceiling.means["contact_relative_residual"].mean < 0.3


def test_surface_and_pressure_are_compared(judged: Judgement, two: RunEvidence) -> None:
    """A surface 0.1 mm below ours is 0.1 mm apart; a pressure sums up to a force, and
    is half of ours; shear that goes across ours is apart by the root of two.
    """
    ours, other = judged.simulators
    area_m2 = 240 * 320 * two.geometry.scale_x_m_px * two.geometry.scale_y_m_px
    for press in other.presses:
        assert press.height_apart_rms_m == pytest.approx(-HEIGHT_M)
        assert press.pressure_force_n == pytest.approx(PRESSURE_PA * area_m2)
        assert press.pressure_apart_relative == pytest.approx(0.5)
        assert press.shear_apart_relative == pytest.approx(2**0.5)
    assert all(press.height_apart_rms_m is None for press in ours.presses)


def test_left_out_presses_are_no_presses(two: RunEvidence, made: SimpleNamespace) -> None:
    """A press that was left out is in no mean, and ours is set against theirs without it."""
    other = _others(two, made, force=1.0, part=1.0)
    last = two.trials[-1].index
    kept = {i: press for i, press in other.presses.items() if i != last}
    ours = replay_outputs(two)
    found = judge(two, [replace(other, presses=kept, left_out=(last,))], ours=ours)
    assert [press.index for press in found.simulators[1].presses] == sorted(kept)
    assert all(c.difference.count == len(kept) for c in contests(found) if c.score.key == "ssim")


def test_depths_are_judged_where_force_was_told(two: RunEvidence) -> None:
    """A simulator that was told the force answers with a depth, and its force is no answer."""
    presses = {
        t.index: PressOutput(
            force_n=t.record.force_measured_n, depth_m=t.record.depth_measured_m + 1e-5
        )
        for t in two.trials
    }
    who = Simulator(name="Deep", version="1", driven_by=Driven.FORCE)
    (only,) = judge(two, [Outputs(simulator=who, presses=presses)]).simulators
    assert only.means["depth_error_m"].mean == pytest.approx(1e-5)
    assert only.means["force_error_relative"].mean is None
    assert only.wins == (0, 0)
