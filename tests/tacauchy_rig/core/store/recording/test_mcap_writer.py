"""Writing a recording: whole, with a disk that fills up, and killed at any moment."""

import errno
import hashlib
import os
import random
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import tacauchy_rig
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ForceSample, ImageFrame, JournalEvent
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import EventMessage, RecordingWriter, encode
from tacauchy_rig.core.store.recovery import recover_recording
from tests.tacauchy_rig.core.store.recording import crash_writer


def test_what_is_written_is_read(finished: Path, samples: Any) -> None:
    """Force, arm, frames, events and metadata come back as they were, to the last bit."""
    recording = Recording.open(finished)
    assert recording.is_intact
    assert recording.message_count == 91
    assert recording.metadata == {"trial": "1"}
    force, arm = recording.force, recording.arm
    for index in range(40):
        sample, state = samples.force(index), samples.arm(index)
        assert force.stamp_ns[index] == sample.stamp_ns
        assert force.counter[index] == sample.counter
        assert tuple(force.wrench[index]) == sample.wrench
        assert arm.stamp_ns[index] == state.stamp_ns
        assert arm.controller_time_s[index] == state.controller_time_s
        assert tuple(arm.pose[index]) == state.pose.as_vector()
        assert tuple(arm.velocity[index]) == state.velocity
        expected = state.tcp_force or (np.nan,) * 6
        np.testing.assert_array_equal(arm.tcp_force[index], expected)
        states = (arm.runtime_state[index], arm.safety_bits[index], arm.robot_mode[index])
        assert states == (2, 1, 7)
    assert list(recording.frames()) == [samples.frame(index) for index in range(10)]
    assert recording.events() == [samples.event(0)]


def test_frames_of_a_window(finished: Path, samples: Any) -> None:
    """Both ends of the asked window belong to it."""
    recording = Recording.open(finished)
    start, end = samples.frame(3).stamp_ns, samples.frame(6).stamp_ns
    assert [frame.counter for frame in recording.frames(start, end)] == [3, 4, 5, 6]
    assert [frame.counter for frame in recording.frames(start_ns=end + 1)] == [7, 8, 9]
    assert [frame.counter for frame in recording.frames(end_ns=start - 1)] == [0, 1, 2]
    stamps, counters = recording.frame_stamps()
    assert counters.tolist() == list(range(10))
    assert stamps[3] == start


def test_streams_are_read_in_order_of_arrival(tmp_path: Path, samples: Any) -> None:
    """Messages that a busy writer got late come back where they belong."""
    path = tmp_path / "recording.mcap"
    with RecordingWriter(path, metadata={}) as writer:
        writer.write([samples.frame(1)])
        writer.write([samples.force(9), samples.force(2)])
        writer.write([samples.frame(0)])
    recording = Recording.open(path)
    assert recording.force.counter.tolist() == [2, 9]
    assert [frame.counter for frame in recording.frames()] == [0, 1]
    assert recording.start_ns == samples.frame(0).stamp_ns
    assert recording.end_ns == samples.force(9).stamp_ns


def test_an_empty_recording_has_empty_streams(tmp_path: Path) -> None:
    """A recording that was closed without a message is intact and gives arrays of length 0."""
    path = tmp_path / "recording.mcap"
    RecordingWriter(path, metadata={}).close()
    recording = Recording.open(path)
    assert recording.is_intact
    assert recording.force.wrench.shape == (0, 6)
    assert recording.arm.pose.shape == (0, 6)
    assert recording.arm.controller_time_s.shape == (0,)
    assert list(recording.frames()) == []
    assert recording.duration_s == 0.0


def test_public_readers_decode_every_message(finished: Path, samples: Any) -> None:
    """The mcap and mcap_protobuf packages read the file without knowing this program."""
    with finished.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        messages = list(reader.iter_decoded_messages())
        summary = reader.get_summary()
    assert Counter(
        (schema.name, channel.topic) for schema, channel, _, _ in messages if schema
    ) == {
        ("foxglove.CompressedImage", "/image"): 10,
        ("tacauchy_rig.Force", "/force"): 40,
        ("tacauchy_rig.Arm", "/arm"): 40,
        ("tacauchy_rig.Event", "/event"): 1,
    }
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 91
    images = [(raw, image) for _, channel, raw, image in messages if channel.topic == "/image"]
    for index, (raw, image) in enumerate(images):
        frame = samples.frame(index)
        assert (raw.log_time, raw.sequence) == (frame.stamp_ns, frame.counter)
        assert (image.format, image.data) == ("jpeg", frame.jpeg)
        assert image.timestamp.seconds * 10**9 + image.timestamp.nanos == frame.stamp_ns
    fz = [force.fz_n for _, channel, _, force in messages if channel.topic == "/force"]
    assert fz == [samples.force(index).wrench[2] for index in range(40)]


def test_each_call_is_readable_when_it_returns(tmp_path: Path, samples: Any) -> None:
    """Another reader sees every message as soon as its call has returned."""
    path = tmp_path / "recording.mcap"
    with RecordingWriter(path, metadata={}) as writer:
        for number in range(1, 6):
            writer.write([samples.force(2 * number), samples.force(2 * number + 1)])
            writer.write([samples.frame(number)])
            recording = Recording.open(path)
            assert recording.message_count == writer.message_count == 3 * number
            assert not recording.finished
            assert recording.torn_bytes == 0


def test_extreme_values_come_back(tmp_path: Path) -> None:
    """NaN, infinities, wrapped counters and stamps near the ends of their range survive."""
    path = tmp_path / "recording.mcap"
    wrench = (float("nan"), float("inf"), -0.0, 1e-320, 1e308, -1e-9)
    sample = ForceSample(stamp_ns=2**62, counter=2**40 + 3, wrench=wrench)
    frame = ImageFrame(
        stamp_ns=0, counter=2**32 - 1, device_stamp_s=-5.0, width=1, height=1, jpeg=b""
    )
    with RecordingWriter(path, metadata={"ключ": "значение"}) as writer:
        writer.write([sample])
        writer.write([frame])
    recording = Recording.open(path)
    expected = np.array(wrench)
    assert recording.force.wrench.tobytes() == expected.tobytes()
    assert recording.force.counter[0] == 2**40 + 3
    (back,) = recording.frames()
    assert (back.counter, back.jpeg, back.device_stamp_s) == (2**32 - 1, b"", None)
    assert recording.metadata == {"ключ": "значение"}


def test_an_event_that_says_something_else(tmp_path: Path) -> None:
    """Whoever made it: file and field are named."""
    path = tmp_path / "odd.mcap"
    with RecordingWriter(path, metadata={}) as writer:
        event = encode(JournalEvent(stamp_ns=5, name="phase"))
        message = EventMessage(stamp_ns=5, name="phase", detail_json="[1]")
        writer.write_raw([replace(event, data=message.SerializeToString())])
    with pytest.raises(RecordError, match=r"odd.mcap: an event: detail: \[1\]: Input should be"):
        Recording.open(path).events()


def test_nothing_is_overwritten(finished: Path) -> None:
    """A second writer on the same path is refused and the recording stays as it was."""
    before = finished.read_bytes()
    with pytest.raises(RecordError, match=r"recording\.mcap: exists already") as caught:
        RecordingWriter(finished, metadata={})
    assert "new attempt" in caught.value.remedy
    assert finished.read_bytes() == before


def test_a_full_disk_keeps_all_that_was_acknowledged(
    tmp_path: Path, samples: Any, file_size_limit: Callable[[int], AbstractContextManager[None]]
) -> None:
    """The message that did not fit is taken back whole; the writer says so, then and later."""
    path = tmp_path / "recording.mcap"
    writer = RecordingWriter(path, metadata={})
    with file_size_limit(200_000):
        for number in range(38):
            writer.write([samples.frame(number)])
        with pytest.raises(RecordError, match="no space left to write") as caught:
            writer.write([samples.frame(38)])
        assert "MB free" in caught.value.message
        assert "run.output_directory" in caught.value.remedy
        with pytest.raises(RecordError, match="no space left"):
            writer.write([samples.force(0)])
    writer.close()
    assert writer.sha256 is None
    recording = Recording.open(path)
    assert recording.message_count == writer.message_count == 38
    assert (recording.finished, recording.torn_bytes, recording.damage) == (False, 0, "")


def test_a_disk_that_fills_up_at_the_end(
    tmp_path: Path, samples: Any, file_size_limit: Callable[[int], AbstractContextManager[None]]
) -> None:
    """When only the index does not fit, closing says so and every message stays."""
    path = tmp_path / "recording.mcap"
    writer = RecordingWriter(path, metadata={})
    samples.write(writer, 10)
    with (
        file_size_limit(path.stat().st_size + 100),
        pytest.raises(RecordError, match="no space left to write"),
    ):
        writer.close()
    recording = Recording.open(path)
    assert (recording.finished, recording.torn_bytes, recording.message_count) == (False, 0, 91)


def test_a_disk_that_fails_to_sync_is_reported(
    tmp_path: Path, samples: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that only the syncing thread sees reaches the writer."""

    def fail(_descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    writer = RecordingWriter(tmp_path / "recording.mcap", metadata={})
    writer.write([samples.force(0)])
    monkeypatch.setattr(os, "fdatasync", fail)
    with pytest.raises(RecordError, match=r"recording\.mcap: cannot be written: Input/output"):
        writer.close()


@pytest.mark.usefixtures("unprivileged")
def test_no_permission() -> None:
    """A folder that may not be written is named, with what to do."""
    with pytest.raises(RecordError, match="no permission to write") as caught:
        RecordingWriter(Path("/sys/tacauchy/recording.mcap"), metadata={})
    assert "/sys/tacauchy" in caught.value.message
    assert "write permission" in caught.value.remedy


def test_the_hash_is_that_of_the_file(finished: Path, tmp_path: Path, samples: Any) -> None:
    """What the writer says when it has closed is what lies on the disk."""
    path = tmp_path / "other.mcap"
    with RecordingWriter(path, metadata={"trial": "1"}) as writer:
        samples.write(writer, 10)
    assert writer.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert path.read_bytes() == finished.read_bytes()


PROGRAM = Path(crash_writer.__file__)
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(tacauchy_rig.__file__).parents[1])}
FIRST_ACKNOWLEDGEMENTS = 3
LONGEST_S = {"paced": 0.6, "fast": 0.15, "closing": 0.06}


def _killed_writer(path: Path, mode: str, *, after_s: float) -> int:
    """Run the writer, kill -9 it ``after_s`` its first lines, return what it acknowledged."""
    command = [sys.executable, str(PROGRAM), str(path), mode]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        first = [process.stdout.readline() for _ in range(FIRST_ACKNOWLEDGEMENTS)]
        time.sleep(after_s)
        process.kill()
        lines = (b"".join(first) + process.stdout.read()).split(b"\n")
    return int(lines[-2])


def _check(path: Path, acknowledged: int) -> int:
    recording = Recording.open(path)
    assert recording.damage == ""
    assert recording.message_count >= acknowledged
    force, frames = recording.force, list(recording.frames())
    assert len(force.counter) + len(frames) == recording.message_count
    assert np.array_equal(force.counter, np.arange(len(force.counter)))
    assert np.array_equal(force.wrench[:, 0], force.counter / 3)
    assert [frame.counter for frame in frames] == list(range(len(frames)))
    assert all(frame.jpeg == crash_writer.jpeg_of(frame.counter) for frame in frames)
    return recording.message_count


@pytest.mark.parametrize(
    ("mode", "seed"),
    [
        *(("paced", seed) for seed in (1, 2)),
        *(("fast", seed) for seed in (3, 4, 5)),
        *(("closing", seed) for seed in (6, 7, 8)),
    ],
)
def test_every_acknowledged_message_survives_kill_9(tmp_path: Path, mode: str, seed: int) -> None:
    """A recorder killed at a random moment loses nothing, before and after recovery."""
    path = tmp_path / "recording.mcap"
    delay = random.Random(seed).uniform(0.0, LONGEST_S[mode])  # noqa: S311
    acknowledged = _killed_writer(path, mode, after_s=delay)
    readable = _check(path, acknowledged)
    report = recover_recording(path)
    assert report.message_count == readable
    assert report.problems == ()
    assert _check(path, acknowledged) == readable
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert sum(1 for _ in reader.iter_decoded_messages()) == readable


def test_a_killed_recovery_loses_nothing(tmp_path: Path) -> None:
    """Recovery that is itself killed leaves the recording readable and can be repeated."""
    path = tmp_path / "recording.mcap"
    acknowledged = _killed_writer(path, "fast", after_s=0.3)
    code = (
        "import sys; from pathlib import Path; "
        "from tacauchy_rig.core.store.recovery import recover_recording; "
        "print('ready', flush=True); recover_recording(Path(sys.argv[1]))"
    )
    for delay in (0.0, 0.01, 0.03, 0.06):
        command = [sys.executable, "-c", code, str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, env=ENVIRONMENT) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(delay)
            process.kill()
        _check(path, acknowledged)
    recover_recording(path)
    assert Recording.open(path).is_intact
    _check(path, acknowledged)
