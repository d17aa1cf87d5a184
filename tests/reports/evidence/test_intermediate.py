"""States on the way beside the recorded frames nearest in force."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from reports.evidence.evidence_types import ImageGeometry
from reports.evidence.frames_and_curves import AttemptReading
from reports.evidence.intermediate_states import intermediate_states
from tacauchy_rig.app.judging.task_and_baseline import surface_values
from tacauchy_rig.core.run import ForceSample, ImageFrame
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore

FORCES_N = np.array([0.3, 0.6, 1.25])


def passed(force_n: NDArray[np.float64] = FORCES_N) -> dict[str, NDArray[Any]]:
    """Return what a replay keeps of a few states."""
    count = len(force_n)
    return {
        "force_n": force_n,
        "depth_m": 2e-4 * force_n,
        "image": np.zeros((count, 12, 16, 3), dtype=np.uint8),
        "dent_m": np.zeros((count, 12, 16)),
        "pressure_pa": np.zeros((count, 12, 16)),
    }


@pytest.fixture
def rising(store: RunStore, press: SimpleNamespace) -> AttemptReading:
    """A press whose force rises from 1 to 2 s evenly; a frame is as bright as its time in 10 ms."""
    path = store.paths.recording(1, 1)
    path.unlink()
    tare_n = press.record(1).tare_before.mean[2]
    with RecordingWriter(path, metadata={}) as writer:
        for k in range(300):
            force_n = press.FORCE_N * np.clip((k - 100) / 100, 0.0, 1.0)
            wrench = (0.0, 0.0, tare_n + force_n, 0.0, 0.0, 0.0)
            stamp_ns = press.at(k * 0.01)
            writer.write([ForceSample(stamp_ns=stamp_ns, counter=k, wrench=wrench)])
            writer.write([press.arm_at(stamp_ns, 0.1997 - 2e-4 * force_n / press.FORCE_N)])
            if k % 4 == 0:
                writer.write([_frame(min(k, 255), stamp_ns, k // 4)])
    return AttemptReading(store, press.record(1), ImageGeometry())


def _frame(brightness: int, stamp_ns: int, counter: int) -> ImageFrame:
    image = np.full((480, 640, 3), brightness, dtype=np.uint8)
    return ImageFrame(
        stamp_ns=stamp_ns,
        counter=counter,
        device_stamp_s=None,
        width=640,
        height=480,
        jpeg=bytes(cv2.imencode(".jpg", image)[1]),
    )


def test_frames_are_of_the_rise_and_the_last_of_the_dwell(
    rising: AttemptReading, press: SimpleNamespace
) -> None:
    """Each within half a frame's rise of its force, as bright as the time at which it had that."""
    states = intermediate_states(passed(), rising)
    assert [state.force_n for state in states] == FORCES_N.tolist()
    for state in states[:-1]:
        frame = state.frame
        assert frame.force_n == pytest.approx(state.force_n, abs=0.02 * press.FORCE_N + 1e-9)
        time_s = frame.image.mean() / 100
        assert press.FORCE_N * (time_s - 1.0) == pytest.approx(frame.force_n, abs=0.02)
        assert frame.depth_m == pytest.approx(2e-4 * frame.force_n / press.FORCE_N, rel=1e-3)
    last = states[-1].frame
    assert last.force_n == press.FORCE_N
    assert last.image.mean() > 200


def test_a_frame_that_is_far_off_is_not_shown(rising: AttemptReading) -> None:
    """No force of the rise is near to one that was never reached."""
    states = intermediate_states(passed(np.array([0.6, 1.6, 1.8])), rising)
    assert states[0].frame is not None
    assert states[1].frame is None


def test_without_states_or_recording_there_is_less(rising: AttemptReading) -> None:
    """An older replay has no states; a recording that cannot be read gives no frames."""
    assert intermediate_states({}, rising) == ()
    assert [state.frame for state in intermediate_states(passed(), None)] == [None] * 3


def test_without_arm_samples_the_frames_have_no_depth(
    rising: AttemptReading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording whose arm samples are gone still shows its frames, by their forces."""
    arm = rising.recording.arm
    none = replace(arm, stamp_ns=arm.stamp_ns[:0], pose=arm.pose[:0])
    monkeypatch.setattr(rising.recording, "arm", none)
    frames = [state.frame for state in intermediate_states(passed(), rising)[:-1]]
    assert [None if frame is None else frame.depth_m for frame in frames] == [None, None]
    assert None not in frames


def test_shear_is_told_where_it_is_asked_for() -> None:
    """Along x and y, linear between nodes, nothing beyond them; None where nobody kept it."""
    corners = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 2.0, 1.0], [2.0, 2.0, 1.0]])
    shear = np.stack([corners[:, 0], -corners[:, 1], np.full(4, 9.0)], axis=1)
    places = np.array([[0.5, 1.5, 5.0]]), np.array([[1.0, 0.25, 5.0]])
    fields = {"node_m": corners, "contact_shear_pa": shear}
    found = surface_values(fields, "contact_shear_pa", *places)
    np.testing.assert_allclose(found, [[[0.5, -1.0], [1.5, -0.25], [0.0, 0.0]]])
    assert surface_values({"node_m": corners}, "contact_shear_pa", *places) is None
