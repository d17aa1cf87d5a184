"""A run folder on disk becomes evidence, and evidence a report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from reports.comparison import compare
from reports.evidence.evidence import ImageGeometry
from reports.evidence.loading import load_evidence, summarize_journal
from tacauchy_rig.config.load import default_text, load_config
from tacauchy_rig.errors import RecordError
from tacauchy_rig.run import (
    ArmSample,
    ForceSample,
    ImageFrame,
    JournalEvent,
    Outcome,
    Pose,
    Replay,
    ReplayTrial,
    Tare,
    TrialRecord,
    Wrench,
)
from tacauchy_rig.store.journal import append_event
from tacauchy_rig.store.recording.writing import RecordingWriter
from tacauchy_rig.store.replay_files import ReplayFields
from tacauchy_rig.store.run_store import RunStore

START_NS = 7_000_000_000
CONTACT_Z_M, TARE_N, FORCE_N, DEPTH_M = 0.1997, 0.8, 1.2556, 2.0e-4
TARE = Tare(
    start_ns=START_NS,
    end_ns=START_NS + 10**9,
    mean=(0.0, 0.0, TARE_N, 0.0, 0.0, 0.0),
    deviation=(0.007,) * 6,
    sample_count=100,
)


def at(second: float) -> int:
    """Return a stamp [ns]."""
    return START_NS + round(second * 1e9)


def record(index: int, *, outcome: Outcome = Outcome.PASSED) -> TrialRecord:
    """Return a press with no-contact frames from 0 to 1 s and a dwell from 2 to 3 s."""
    return TrialRecord(
        index=index,
        attempt=1,
        outcome=outcome,
        force_target_n=FORCE_N,
        force_measured_n=FORCE_N,
        contact_z_m=CONTACT_Z_M,
        depth_measured_m=DEPTH_M,
        tare_before=TARE,
        reference_start_ns=at(0.0),
        reference_end_ns=at(1.0),
        dwell_start_ns=at(2.0),
        dwell_end_ns=at(3.0),
    )


def write_recording(path: Path, made: SimpleNamespace) -> None:
    """Record 3.5 s of force, arm and images; the image shows the punch from 1.5 s on."""

    def jpeg(values: np.ndarray) -> bytes:
        framed = cv2.copyMakeBorder(made.to_image(values), 51, 51, 68, 68, cv2.BORDER_REPLICATE)
        large = cv2.resize(framed, (640, 480), interpolation=cv2.INTER_LINEAR)
        return bytes(cv2.imencode(".jpg", large[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 97])[1])

    unloaded = jpeg(made.background())
    pressed = jpeg(made.background() + made.contact_change(FORCE_N * 3))
    with RecordingWriter(path, metadata={}) as writer:
        for k in range(350):
            force = TARE_N + (FORCE_N if k >= 150 else 0.0)
            z = CONTACT_Z_M - (DEPTH_M if k >= 150 else -1e-3)
            counter = k if k < 100 else k + 3
            wrench = Wrench(force=(0.0, 0.0, force), torque=(0.0, 0.0, 0.0))
            stamp = at(k * 0.01)
            writer.write_force([ForceSample(stamp_ns=stamp, counter=counter, wrench=wrench)])
            writer.write_arm(
                [
                    ArmSample(
                        stamp_ns=stamp,
                        controller_time_s=k * 0.01,
                        pose=Pose(position=(0.0, -0.4, z), rotation_vector=(0.0, 3.14, 0.0)),
                        velocity=(0.0,) * 6,
                        runtime_state=2,
                        safety_bits=1,
                        robot_mode=7,
                    )
                ]
            )
            if k % 4 == 0:
                writer.write_frame(
                    ImageFrame(
                        stamp_ns=stamp,
                        counter=k // 4,
                        device_stamp_s=None,
                        width=640,
                        height=480,
                        jpeg=pressed if k >= 150 else unloaded,
                    )
                )


def replay_of(records: list[TrialRecord]) -> Replay:
    """Return a replay that matches within 0.02 N."""
    trials = tuple(
        ReplayTrial(
            index=r.index,
            force_measured_n=FORCE_N,
            force_simulated_n=FORCE_N + 0.02,
            depth_simulated_m=1.9e-4,
            force_error_estimate=0.03,
            force_error_basis="made up for this test",
            newton_iterations=9,
            search_iterations=3,
            wall_s={"solve": 1.0},
            balance_relative=1e-9,
            gap_min_m=1e-6,
            min_jacobian=0.8,
            force_history=((1e-4, 0.6), (1.9e-4, FORCE_N + 0.02), (2.5e-4, 1.7)),
        )
        for r in records
    )
    return Replay(name="main", trials=trials, model={"young_pa": 435e3}, versions={"x": "1"})


@pytest.fixture
def store(tmp_path: Path, made: SimpleNamespace) -> RunStore:
    """A run of six targets of which the first was pressed, and the second failed unrecorded."""
    run = RunStore.create(
        tmp_path,
        load_config(),
        config_text=default_text(),
        simulated=True,
        versions={"tacauchy-rig": "0"},
    )
    path = run.paths.recording(1, 1)
    path.parent.mkdir(parents=True)
    write_recording(path, made)
    run.save_result(record(1))
    run.save_result(replace(record(2), outcome=Outcome.FAULT, reason="unplugged"))
    for name, detail in (("attempt-start", {}), ("fault", {"reason": "camera: silent"})):
        append_event(
            run.paths.journal,
            JournalEvent(stamp_ns=1, name=name, trial=2, attempt=1, detail=detail),
        )
    image = made.to_image(made.background() + made.contact_change(FORCE_N * 3))
    run.save_replay(replay_of([record(1)]), {1: ReplayFields(image=image)})
    return run


def test_streams_become_images_curves_and_timing(store: RunStore, made: SimpleNamespace) -> None:
    """Frames, force, depth and losses of a recording arrive where the report looks for them."""
    first = load_evidence(store, store.load_replay("main")).trials[0]
    assert first.images is not None
    assert first.images.frame_count == 26
    truth = made.to_image(made.background() + made.contact_change(FORCE_N * 3))
    assert np.abs(first.images.real.astype(int) - truth).mean() < 3.0
    assert np.abs(first.images.reference.astype(int) - made.background()).mean() < 3.0
    assert first.force_curve is not None
    assert first.depth_curve is not None
    pressed = first.force_curve.time_s > 0.0
    assert first.force_curve.value[pressed] == pytest.approx(FORCE_N)
    assert first.depth_curve.value[pressed] == pytest.approx(DEPTH_M)
    assert first.dwell_s == pytest.approx((0.0, 1.0))
    losses = {s.name: s.lost_count for s in first.streams}
    assert losses == {"force": 3, "image": 0, "arm": None}


def test_report_of_a_run_that_broke_off(store: RunStore) -> None:
    """What was pressed is scored, what was not fails, and the truth is compared."""
    truth = {"young_pa": 430e3, "surface_error_m": -2.5e-4}
    store.paths.truth.write_text(json.dumps(truth))
    store.paths.emulation.mkdir()
    rows = [
        {"stamp_ns": at(k * 0.01), "force_true_n": 1.25, "depth_true_m": 2.1e-4} for k in range(350)
    ]
    (store.paths.emulation / "force_trace.jsonl").write_text(
        "\n".join(json.dumps(row) for row in rows) + "\n"
    )
    report = compare(load_evidence(store, store.load_replay("main")))
    assert [t.outcome for t in report.trials[:3]] == ["passed", "fault", "missing"]
    assert report.trials[0].passed
    assert not report.passed
    names = {c.name: c for c in report.truth}
    assert names["mean force in the dwell"].true == pytest.approx(1.25)
    assert names["height of the gel above the expected"].recovered == pytest.approx(-0.3)
    assert report.evidence.provenance["seed"] == 7
    assert report.evidence.journal.faults == ("trial 2, attempt 1: fault: camera: silent",)


def test_passed_trial_without_its_recording_is_an_error(store: RunStore) -> None:
    """A recording that should be there is missed by name, not skipped."""
    store.paths.recording(1, 1).unlink()
    with pytest.raises(RecordError, match=r"recording\.mcap"):
        load_evidence(store, None)


def test_run_that_was_not_replayed(store: RunStore) -> None:
    """Without a replay the forces and images of the press are kept and nothing is invented."""
    evidence = load_evidence(store, None)
    assert evidence.trials[0].simulated_image is None
    assert evidence.trials[0].force_depth_simulated is None
    assert evidence.trials[0].images is not None


def test_forces_are_predicted_with_the_stated_modulus(store: RunStore) -> None:
    """A gel that was replayed twice as stiff as stated predicts half of those forces."""
    replay = replay_of([record(1)])
    stated = load_evidence(store, replay).trials[0].force_depth_simulated
    stiffer = replace(replay, model={**replay.model, "modulus_factor": 2.0})
    found = load_evidence(store, stiffer).trials[0].force_depth_simulated
    assert stated is not None
    assert found is not None
    assert found[:, 0] == pytest.approx(stated[:, 0])
    assert found[:, 1] == pytest.approx(0.5 * stated[:, 1])
    deeper = {**stiffer.model, "stated_force_history": [[3e-4, 1.1]]}
    whole = load_evidence(store, replace(stiffer, model=deeper)).trials[0].force_depth_simulated
    assert whole is not None
    assert whole[-1] == pytest.approx([3e-4, 1.1])
    assert whole[:-1] == pytest.approx(found)


def test_scored_size_follows_the_sensor(store: RunStore) -> None:
    """Another geometry gives images of that size."""
    geometry = ImageGeometry(crop_fraction=0.0, width_px=160, height_px=120)
    images = load_evidence(store, None, geometry=geometry).trials[0].images
    assert images is not None
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
