"""Whatever is killed at whatever moment, acknowledged messages stay readable."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import tacauchy_rig
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.recovery import recover_recording
from tests.tacauchy_rig.core.store.recording import crash_writer

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
    force, frames = recording.force(), list(recording.frames())
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
