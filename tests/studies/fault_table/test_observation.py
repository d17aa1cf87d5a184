"""Counting what was acknowledged and what can be read."""

import pytest

from tacauchy_rig.core.run import ForceSample, ImageFrame, JournalEvent
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_files import RunPaths
from tests.studies.fault_table.observation import acknowledged_messages, kept_messages


def force(*counters):
    """Return force samples with these package numbers."""
    wrench = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return [ForceSample(stamp_ns=10 * n, counter=n, wrench=wrench) for n in counters]


def frame(counter):
    """Return a frame."""
    return ImageFrame(
        stamp_ns=40 * counter,
        counter=counter,
        device_stamp_s=None,
        width=4,
        height=4,
        jpeg=b"\xff\xd8\xff\xd9",
    )


@pytest.fixture
def paths(tmp_path):
    """Return a run folder with one attempt, torn between recording and spill."""
    paths = RunPaths(tmp_path)
    paths.attempt(1, 1).mkdir(parents=True)
    recording = RecordingWriter(paths.recording(1, 1), metadata={})
    recording.write(force(1, 2, 3))
    for number in (1, 2):
        recording.write([frame(number)])
    recording.write([JournalEvent(stamp_ns=5, name="attempt-start", trial=1, attempt=1)])
    recording.close()
    spill = RecordingWriter(paths.spill(1, 1, "control"), metadata={})
    spill.write(force(3, 4))
    spill.close()
    return paths


def test_a_message_in_recording_and_spill_counts_once(paths):
    """Sample 3 was written, but its acknowledgement never arrived, so it was spilled too."""
    kept = kept_messages(paths, paths.attempts(), {"control": 4, "camera": 2})
    assert kept.readable == {"control": 5, "camera": 2}
    assert (kept.lost_count, kept.force_gap_count, kept.frame_gap_count) == (0, 0, 0)


def test_an_acknowledged_message_that_cannot_be_read_is_lost(paths):
    """More messages of one producer do not make up for those of the other."""
    kept = kept_messages(paths, paths.attempts(), {"control": 1, "camera": 5})
    assert kept.lost_count == 3


def test_whoever_survived_tells_what_was_acknowledged():
    """The recorder's own word, or the supervisor's where the recorder was killed."""
    recorder = JournalEvent(
        stamp_ns=1, name="record-end", detail={"acknowledged": {"control": 9, "camera": 4}}
    )
    supervisor = JournalEvent(
        stamp_ns=2, name="run-end", detail={"acknowledged": {"control": 7, "camera": 5}}
    )
    assert acknowledged_messages([recorder]) == {"control": 9, "camera": 4}
    assert acknowledged_messages([supervisor]) == {"control": 7, "camera": 5}
    assert acknowledged_messages([recorder, supervisor]) == {"control": 9, "camera": 5}
    assert acknowledged_messages([]) == {"control": 0, "camera": 0}
