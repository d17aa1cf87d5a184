"""The report holds what the protocol said of a press against what its recording says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import pytest

from reports.comparison.compare import compare
from reports.comparison.criteria import RECORDED, judge_record
from reports.comparison.results import ValidationReport
from reports.evidence.attempt import RunReading
from reports.evidence.evidence import ImageGeometry, RunEvidence
from reports.evidence.loading import load_evidence
from reports.page.writing import write_report
from tacauchy_rig.run import Criterion, ForceSample, Wrench
from tacauchy_rig.store.recording.reading import Recording
from tacauchy_rig.store.recording.writing import RecordingWriter
from tacauchy_rig.store.run_store import RunStore

TARE_N, FORCE_N = 0.8, 1.2556


def tamper(store: RunStore, change: Callable[[float], float]) -> None:
    """Write the recording again with other raw forces; its checksums are right."""
    path = store.paths.recording(1, 1)
    recording = Recording.open(path)
    force, frames = recording.force(), list(recording.frames())
    path.unlink()
    with RecordingWriter(path, metadata=recording.metadata) as writer:
        writer.write(
            [
                ForceSample(
                    stamp_ns=int(stamp),
                    counter=int(counter),
                    wrench=Wrench(force=(0.0, 0.0, change(float(row[2]))), torque=(0.0, 0.0, 0.0)),
                )
                for stamp, counter, row in zip(
                    force.stamp_ns, force.counter, force.wrench, strict=True
                )
            ]
        )
        for frame in frames:
            writer.write([frame])
    assert Recording.open(path).is_intact


def report_of(store: RunStore) -> ValidationReport:
    """Compare the run with its replay."""
    run = RunReading(store, ImageGeometry())
    return compare(load_evidence(run, store.load_replay("main")))


def missed(report: ValidationReport) -> dict[str, Criterion]:
    """Return the criteria of the first trial that were missed."""
    return {c.name: c for c in report.trials[0].criteria if c.name in RECORDED and not c.passed}


def test_a_recording_as_it_was_written_agrees(store: RunStore) -> None:
    """All three are there and met; tare, mean and sign are those of the samples."""
    found = {c.name: c for c in report_of(store).trials[0].criteria if c.name in RECORDED}
    assert all(c.passed for c in found.values())
    assert found["recorded_tare"].measured == pytest.approx(TARE_N)
    assert found["recorded_force"].measured == pytest.approx(FORCE_N)
    assert found["recorded_sign"].measured == pytest.approx(FORCE_N)


def test_forces_ten_times_too_large_fail(store: RunStore) -> None:
    """Tare and mean both say other numbers than the protocol did."""
    tamper(store, lambda value: 10.0 * value)
    found = missed(report_of(store))
    assert set(found) == {"recorded_tare", "recorded_force"}
    assert found["recorded_force"].measured == pytest.approx(10.0 * FORCE_N)
    assert "1.2556 N" in found["recorded_force"].limit
    assert found["recorded_tare"].measured == pytest.approx(10.0 * TARE_N)
    assert "0.8 N" in found["recorded_tare"].limit


def test_a_flipped_sign_fails(store: RunStore) -> None:
    """About the same zero the other way: the tare stands, force and sign do not."""
    tamper(store, lambda value: 2.0 * TARE_N - value)
    found = missed(report_of(store))
    assert set(found) == {"recorded_force", "recorded_sign"}
    assert found["recorded_sign"].measured == pytest.approx(-FORCE_N)
    assert "compression_sign +1" in found["recorded_sign"].limit


@pytest.mark.parametrize("shift_n", [0.003, -0.05])
def test_a_shifted_zero_fails(store: RunStore, shift_n: float) -> None:
    """A shift of all samples leaves the difference and shows in the tare alone."""
    tamper(store, lambda value: value + shift_n)
    assert set(missed(report_of(store))) == {"recorded_tare"}


def test_noise_of_the_mean_is_no_finding(store: RunStore) -> None:
    """What half of the samples could say otherwise lies within the limit."""
    tamper(store, lambda value: value + 0.0007)
    assert missed(report_of(store)) == {}


def test_another_tare_than_was_recorded_fails(store: RunStore, press: SimpleNamespace) -> None:
    """A result that was edited says another zero, and so another force, than its samples."""
    record = press.record(1)
    mean = (0.0, 0.0, TARE_N - 0.1, 0.0, 0.0, 0.0)
    store.paths.result(1, 1).unlink()
    store.save_result(
        replace(record, tare_before=replace(record.tare_before, mean=mean), force_measured_n=1.3556)
    )
    assert set(missed(report_of(store))) == {"recorded_tare", "recorded_force"}


def test_a_recording_without_samples_fails(store: RunStore) -> None:
    """A press whose samples are gone is not taken on trust."""
    path = store.paths.recording(1, 1)
    frames = list(Recording.open(path).frames())
    path.unlink()
    with RecordingWriter(path, metadata={}) as writer:
        for frame in frames:
            writer.write([frame])
    found = missed(report_of(store))
    assert set(found) == set(RECORDED)
    assert all("recover RUN" in c.remedy for c in found.values())


def test_it_is_told_wherever_a_criterion_is(store: RunStore, tmp_path: Path) -> None:
    """Both numbers and the unit stand in verdict, page, summary.json and junit.xml."""
    tamper(store, lambda value: 10.0 * value if value > 1.0 else value)
    report = report_of(store)
    assert "trial 1 (recorded force 19.756 N, asked: within" in report.verdict
    assert "1.2556 N, the mean that the protocol measured" in report.verdict
    paths = write_report(report, tmp_path / "report")
    for file in (paths.html, paths.summary):
        text = file.read_text("utf-8")
        assert "1.2556 N, the mean that the protocol measured" in text
        assert "tell of different presses" in text
    root = ET.fromstring(paths.junit.read_text("utf-8"))  # noqa: S314 (our own file)
    (failure,) = root.findall(".//testcase[@name='recorded_force']/failure")[:1]
    assert "measured 19.756 N; limit: within" in failure.attrib["message"]
    assert "1.2556 N" in failure.attrib["message"]
    assert "resume RUN" in (failure.text or "")


def test_tolerance_is_three_standard_errors(evidence: RunEvidence) -> None:
    """Scatter 9 mN in 120 samples and 7 mN in 100 of the tare: 3.2 mN of the mean force."""
    trial = evidence.trials[0]
    assert trial.recorded is not None

    def judged(shift_n: float) -> bool:
        recorded = replace(trial.recorded, rise_n=trial.recorded.rise_n + shift_n)
        criteria = judge_record(replace(trial, recorded=recorded))
        return next(c.passed for c in criteria if c.name == "recorded_force")

    assert judged(0.0032)
    assert judged(-0.0032)
    assert not judged(0.0033)
