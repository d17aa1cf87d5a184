"""A run folder on disk becomes evidence, and evidence a report."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import ImageGeometry, RunEvidence
from reports.evidence.frames_and_curves import RunReading
from reports.evidence.gather_evidence import load_evidence, read_true_dwells, summarize_journal
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.run_store import RunStore
from tests.made_model import made_model


def evidence_of(
    store: RunStore, replay: Replay | None, *, geometry: ImageGeometry | None = None
) -> RunEvidence:
    """Read a run from its folder."""
    return load_evidence(RunReading(store, geometry or ImageGeometry()), replay)


def test_streams_become_images_curves_and_timing(
    store: RunStore, made: SimpleNamespace, press: SimpleNamespace
) -> None:
    """Frames, force, depth and losses of a recording arrive where the report looks for them."""
    first = evidence_of(store, store.load_replay("main")).trials[0]
    assert first.images.frame_count == 26
    truth = made.to_image(made.background() + made.contact_change(press.FORCE_N * 3))
    assert np.abs(first.images.real.astype(int) - truth).mean() < 3.0
    assert np.abs(first.images.reference.astype(int) - made.background()).mean() < 3.0
    pressed = first.force_curve.time_s > 0.0
    assert first.force_curve.value[pressed] == pytest.approx(press.FORCE_N)
    assert first.depth_curve.value[pressed] == pytest.approx(press.DEPTH_M)
    assert first.dwell_s == pytest.approx((0.0, 1.0))
    losses = {s.name: s.lost_count for s in first.streams}
    assert losses == {"force": 3, "image": 0, "arm": None}


def test_report_of_a_run_that_broke_off(store: RunStore, press: SimpleNamespace) -> None:
    """What was pressed is scored, what was not fails, and the truth is compared."""
    truth = {"young_pa": 430e3, "surface_error_m": -2.5e-4}
    store.paths.truth.write_text(json.dumps(truth))
    store.paths.emulation.mkdir()
    rows = [
        {"stamp_ns": press.at(k * 0.01), "force_true_n": 1.25, "depth_true_m": 2.1e-4}
        for k in range(350)
    ]
    (store.paths.emulation / "force_trace.jsonl").write_text(
        "\n".join(json.dumps(row) for row in rows) + "\n"
    )
    report = compare(evidence_of(store, store.load_replay("main")))
    assert [t.outcome for t in report.trials[:3]] == ["passed", "fault", "missing"]
    judged = {c.name: c.passed for c in report.trials[0].criteria}
    assert judged["press"]
    assert judged["recorded_force"]
    assert judged["contact_residual"]
    assert not report.passed
    names = {c.name: c for c in report.truth}
    assert names["mean force in the dwell"].true == pytest.approx(1.25)
    assert names["height of the gel above the expected"].recovered == pytest.approx(-0.3)
    assert report.evidence.provenance["seed"] == 7
    assert report.evidence.journal.faults == ("trial 2, attempt 1: fault: camera: silent",)


def test_run_that_was_not_replayed(store: RunStore) -> None:
    """Without a replay the forces and images of the press are kept and nothing is invented."""
    evidence = evidence_of(store, None)
    assert evidence.trials[0].simulated_image is None
    assert evidence.trials[0].force_depth_simulated is None
    assert evidence.trials[0].images is not None


def test_forces_are_predicted_with_the_stated_modulus(
    store: RunStore, press: SimpleNamespace
) -> None:
    """A gel that was replayed twice as stiff as stated predicts half of those forces."""
    replay = press.replay_of([press.record(1)])
    stated = evidence_of(store, replay).trials[0].force_depth_simulated
    stiffer = replace(replay, model=made_model(modulus_factor=2.0))
    found = evidence_of(store, stiffer).trials[0].force_depth_simulated
    assert found.depth_m == pytest.approx(stated.depth_m)
    assert found.force_n == pytest.approx(0.5 * stated.force_n)
    deeper = replace(stiffer.model, stated_force_history=((3e-4, 1.1),))
    whole = evidence_of(store, replace(stiffer, model=deeper)).trials[0].force_depth_simulated
    assert (whole.depth_m[-1], whole.force_n[-1]) == pytest.approx((3e-4, 1.1))
    assert whole.depth_m[:-1] == pytest.approx(found.depth_m)
    assert whole.force_n[:-1] == pytest.approx(found.force_n)


def test_scored_size_follows_the_sensor(store: RunStore) -> None:
    """Another geometry gives images of that size."""
    geometry = ImageGeometry(crop_fraction=0.0, width_px=160, height_px=120)
    images = evidence_of(store, None, geometry=geometry).trials[0].images
    assert images.real.shape == (120, 160, 3)


def test_journal_is_counted() -> None:
    """Attempts, faults, dead processes, aborts and resumptions."""
    names = ["attempt-start", "fault", "resume", "attempt-start", "process-died", "abort"]
    events = [
        JournalEvent(stamp_ns=k, name=n, detail={"process": "camera", "how": "signal 9"})
        for k, n in enumerate(names)
    ]
    counted = summarize_journal(events)
    assert (counted.attempt_count, counted.fault_count) == (2, 2)
    assert (counted.abort_count, counted.resume_count) == (1, 1)
    assert "process-died: camera signal 9" in counted.faults


def test_trace_is_averaged_over_the_dwell(tmp_path: Path) -> None:
    """Only frames inside the window count; a torn last line and a restarted trace do no harm."""
    trace = tmp_path / "force_trace.jsonl"
    rows = [
        {
            "number": k,
            "stamp_ns": k * 10,
            "force_true_n": 2.0 if k < 50 else 9.0,
            "depth_true_m": 1e-4,
        }
        for k in range(100)
    ]
    rows[3]["depth_true_m"] = None
    odd = ["[]", '{"stamp_ns": 10, "force_true_n": "x", "depth_true_m": []}']
    lines = [*odd, *(json.dumps(row) for row in rows)]
    trace.write_text("\n".join(lines) + '\n{"number": 1')
    found = read_true_dwells(trace, {1: (0, 490), 2: (5000, 6000)})
    assert found == {1: pytest.approx((2.0, 1e-4))}
    assert read_true_dwells(tmp_path / "absent.jsonl", {1: (0, 490)}) == {}


def test_a_damaged_result_is_a_criterion_of_its_trial(
    store: RunStore, press: SimpleNamespace
) -> None:
    """An older attempt that passed does not count in its place without a word."""
    store.save_result(replace(press.record(1), attempt=2))
    path = store.paths.result(1, 2)
    path.write_bytes(path.read_bytes()[:200])
    trial, *others = compare(evidence_of(store, store.load_replay("main"))).trials
    missed = {c.name: c for c in trial.criteria if not c.passed}
    assert trial.attempt == 1
    assert "attempt-2/result.json: not valid JSON" in missed["result_whole"].limit
    assert "resume RUN --again 1" in missed["result_whole"].remedy
    kept = [c for other in others for c in other.criteria if c.name == "result_whole"]
    assert kept
    assert all(criterion.passed for criterion in kept)


def test_a_run_without_any_readable_result_is_refused(store: RunStore) -> None:
    """There is nothing to make a page of; the file is named."""
    for trial in (1, 2):
        store.paths.result(trial, 1).write_bytes(b"{")
    with pytest.raises(RecordError, match=r"nothing is left to report.*result\.json"):
        evidence_of(store, None)


def test_damaged_files_beside_the_trials_are_criteria(store: RunStore) -> None:
    """A replayed image, the truth and the check of the cell: the page says so and goes on."""
    image = store.paths.replay_trial("main", 1) / "image.png"
    image.write_bytes(image.read_bytes()[:100])
    for path in (store.paths.truth, store.paths.force_check):
        path.write_bytes(b"{")
    evidence = evidence_of(store, store.load_replay("main"))
    report = compare(evidence)
    missed = {c.name: c for c in (*report.criteria, *report.trials[0].criteria) if not c.passed}
    assert "image.png: not a readable PNG" in missed["replay_whole"].limit
    assert "truth.json: not valid JSON" in missed["run_description"].limit
    assert {"contact_residual", "replay_files"} <= missed.keys()
    assert evidence.world is None
    assert evidence.force_check is None
