"""A recorded press on disk: force, arm and images that are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tacauchy_rig.config.load import default_text, load_config
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
from tests.made_model import made_model

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


def arm_at(stamp_ns: int, z_m: float) -> ArmSample:
    """Return the arm at rest with its tip at a height."""
    return ArmSample(
        stamp_ns=stamp_ns,
        controller_time_s=(stamp_ns - START_NS) * 1e-9,
        pose=Pose(position=(0.0, -0.4, z_m), rotation_vector=(0.0, 3.14, 0.0)),
        velocity=(0.0,) * 6,
        runtime_state=2,
        safety_bits=1,
        robot_mode=7,
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
            writer.write_arm([arm_at(stamp, z)])
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
    return Replay(name="main", trials=trials, model=made_model(), versions={"x": "1"})


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


@pytest.fixture(scope="session")
def press() -> SimpleNamespace:
    """What the recorded press is made with, for tests that need another one."""
    return SimpleNamespace(
        at=at,
        arm_at=arm_at,
        record=record,
        replay_of=replay_of,
        write=write_recording,
        FORCE_N=FORCE_N,
        DEPTH_M=DEPTH_M,
    )
