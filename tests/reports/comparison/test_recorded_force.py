"""The report says where the protocol and its recording tell of different presses."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from reports.comparison.result_types import ValidationReport
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import ImageGeometry
from reports.evidence.frames_and_curves import RunReading
from reports.evidence.gather_evidence import load_evidence
from reports.page.summary_and_junit import write_report
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import (
    ForceMessage,
    RawMessage,
    RecordingWriter,
    Topic,
)
from tacauchy_rig.core.store.run_store import RunStore

TARE_N, FORCE_N = 0.8, 1.2556


def tamper(store: RunStore, change: Callable[[float], float]) -> None:
    """Write the recording again with other raw forces; its checksums are right."""
    path = store.paths.recording(1, 1)
    recording = Recording.open(path)
    messages = list(recording.raw_messages())
    path.unlink()
    with RecordingWriter(path, metadata=recording.metadata) as writer:
        writer.write_raw([_changed(message, change) for message in messages])
    assert Recording.open(path).is_intact


def _changed(message: RawMessage, change: Callable[[float], float]) -> RawMessage:
    if message.topic is not Topic.FORCE:
        return message
    force = ForceMessage.FromString(message.data)
    force.fz_n = change(force.fz_n)
    return replace(message, data=force.SerializeToString())


def report_of(store: RunStore) -> ValidationReport:
    """Compare the run with its replay."""
    run = RunReading(store, ImageGeometry())
    return compare(load_evidence(run, store.load_replay("main")))


def missed(report: ValidationReport) -> dict[str, Criterion]:
    """Return the criteria of the first trial that were missed."""
    ours = [c for c in report.trials[0].criteria if c.name.startswith(("record", "result"))]
    return {c.name: c for c in ours if not c.passed}


def test_a_recording_as_it_was_written_agrees(store: RunStore) -> None:
    """Tare, mean and sign are there and met, and are those of the samples."""
    report = report_of(store)
    found = {c.name: c for c in report.trials[0].criteria}
    assert missed(report) == {}
    assert all(c.passed for c in report.criteria)
    assert found["recorded_tare"].measured == pytest.approx(TARE_N)
    assert found["recorded_force"].measured == pytest.approx(FORCE_N)
    assert found["recorded_sign"].measured == pytest.approx(FORCE_N)


def test_noise_of_the_mean_is_no_finding_where_samples_may_be_lost(store: RunStore) -> None:
    """What half of the samples could say otherwise lies within the limit: three standard errors."""
    tamper(store, lambda value: value + 0.0007)
    assert missed(report_of(store)) == {}
    tamper(store, lambda value: value + 0.003)
    assert set(missed(report_of(store))) == {"recorded_tare"}


@pytest.mark.usefixtures("undrawn")
def test_it_is_told_wherever_a_criterion_is(store: RunStore, tmp_path: Path) -> None:
    """Both numbers and the unit stand in verdict, page, summary.json and junit.xml."""
    tamper(store, lambda value: 10.0 * value if value > 1.0 else value)
    report = report_of(store)
    assert "trial 1 (recorded force 19.76 N, required: within" in report.verdict
    assert "1.2556 N, as result.json says" in report.verdict
    assert "the run as a whole (replay files 1 wrong, required" in report.verdict
    paths = write_report(report, tmp_path / "report")
    for file in (paths.html, paths.summary):
        text = file.read_text("utf-8")
        assert "1.2556 N, as result.json says" in text
        assert "tell of different presses" in text
    root = ET.fromstring(paths.junit.read_text("utf-8"))  # noqa: S314 (our own file)
    (failure,) = root.findall(".//testcase[@name='recorded_force']/failure")[:1]
    assert "measured 19.756 N; limit: within" in failure.attrib["message"]
    assert "1.2556 N" in failure.attrib["message"]
    assert "resume RUN" in (failure.text or "")
    (of_the_run,) = root.findall(".//testcase[@classname='run'][@name='replay_files']/failure")
    assert "recording.mcap has the sha256" in of_the_run.attrib["message"]


@pytest.mark.usefixtures("undrawn")
def test_a_recording_that_is_gone_is_a_criterion_missed(store: RunStore, tmp_path: Path) -> None:
    """The page is written all the same, and says what is missing and what to do."""
    store.paths.recording(1, 1).unlink()
    report = report_of(store)
    found = missed(report)["recording_whole"]
    assert "recording.mcap: the recording is missing" in found.limit
    assert "--again 1`" in found.remedy
    write_report(report, tmp_path / "report")


def test_a_journal_that_is_gone_is_a_criterion_missed(store: RunStore) -> None:
    """The report is made without it and does not pass."""
    store.paths.journal.unlink()
    chain = next(c for c in report_of(store).criteria if c.name == "journal_chain")
    assert not chain.passed
    assert "journal.jsonl is missing" in chain.limit
