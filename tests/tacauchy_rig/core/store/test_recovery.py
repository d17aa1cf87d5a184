"""Recovery: torn, damaged and spilled messages become one finished file, and nothing is lost."""

import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.json_codec import dumps
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import Recorded, RecordingWriter
from tacauchy_rig.core.store.recovery import recover_recording, recover_recordings
from tacauchy_rig.core.store.run_files import RunPaths


def spilled(folder: Path, source: str, *items: Recorded, **metadata: str) -> None:
    """Leave what a process could not hand to its recorder."""
    with RecordingWriter(folder / f"unacknowledged-{source}.mcap", metadata=metadata) as spill:
        spill.write(items)


def _public_count(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())


def test_a_torn_recording_is_repacked(finished: Path) -> None:
    """A cut file is refused by public readers before and read by them after."""
    torn = finished.read_bytes()[:40_000]
    finished.write_bytes(torn)
    before = Recording.open(finished)
    messages = list(before.raw_messages())
    report = recover_recording(finished)
    assert report.changed
    assert report.problems == ()
    assert report.before == before.describe()
    after = Recording.open(finished)
    assert after.is_intact
    assert list(after.raw_messages()) == messages
    assert after.metadata == {"trial": "1"}
    assert _public_count(finished) == report.message_count == len(messages)
    assert report.original == finished.with_name("recording.mcap.torn")
    assert report.original.read_bytes() == torn


def test_an_intact_recording_is_left_alone(finished: Path) -> None:
    """Recovery of a whole file changes nothing, and neither does a second recovery."""
    content = finished.read_bytes()
    report = recover_recording(finished)
    assert not report.changed
    assert report.message_count == 91
    assert finished.read_bytes() == content
    finished.write_bytes(content[:50_000])
    recover_recording(finished)
    repacked = finished.read_bytes()
    assert not recover_recording(finished).changed
    assert finished.read_bytes() == repacked
    assert sorted(path.name for path in finished.parent.iterdir()) == [
        "recording.mcap",
        "recording.mcap.torn",
    ]


def test_damage_in_the_middle_is_reported(finished: Path) -> None:
    """What could not be saved is said, and a second torn file gets a name of its own."""
    for suffix in ("torn", "torn-2"):
        content = bytearray(finished.read_bytes())
        content[20_000] ^= 1
        finished.write_bytes(bytes(content))
        report = recover_recording(finished)
        assert "are damaged" in report.problems[0]
        assert report.original == finished.with_name(f"recording.mcap.{suffix}")
    assert Recording.open(finished).is_intact


def test_spills_are_merged_once(finished: Path, samples: Any) -> None:
    """Messages that the recorder had not acknowledged come back, those that it had only once."""
    folder = finished.parent
    spilled(folder, "control", samples.force(39), samples.force(40), samples.force(41))
    spilled(folder, "camera", samples.frame(9), samples.frame(10))
    report = recover_recording(finished)
    assert (report.message_count, report.merged_count) == (94, 3)
    recording = Recording.open(finished)
    assert recording.force.counter.tolist() == list(range(42))
    assert recording.frame_stamps()[1].tolist() == list(range(11))
    names = sorted(path.name for path in folder.glob("unacknowledged*"))
    assert names == ["unacknowledged-camera.mcap.merged", "unacknowledged-control.mcap.merged"]
    assert not recover_recording(finished).changed


def test_a_spill_without_a_recording(tmp_path: Path, samples: Any) -> None:
    """When the recorder never wrote a byte, the spill alone becomes the recording."""
    path = tmp_path / "recording.mcap"
    spilled(tmp_path, "control", samples.force(0))
    assert recover_recording(path).merged_count == 1
    assert Recording.open(path).is_intact


def test_a_spill_beside_an_empty_recording(tmp_path: Path, samples: Any) -> None:
    """An unreadable recording is kept and named, and does not keep the spill from being saved."""
    path = tmp_path / "recording.mcap"
    path.touch()
    spilled(tmp_path, "control", samples.force(0))
    (tmp_path / "unacknowledged-camera.mcap").touch()
    report = recover_recording(path)
    assert report.message_count == 1
    assert ["is empty" in problem for problem in report.problems] == [True]
    assert (tmp_path / "recording.mcap.torn").stat().st_size == 0
    assert Recording.open(path).is_intact


def closed(path: Path) -> bytes:
    """Give a recording the result that tells its hash; return its content."""
    content = path.read_bytes()
    record = TrialRecord(
        index=1,
        attempt=1,
        outcome=Outcome.PASSED,
        force_target_n=1.0,
        recording_sha256=hashlib.sha256(content).hexdigest(),
    )
    path.with_name("result.json").write_bytes(dumps(record))
    return content


def test_a_closed_recording_is_never_written_again(finished: Path, samples: Any) -> None:
    """A spill that tells more than it is refused once; one that tells less is done with."""
    content = closed(finished)
    folder = finished.parent
    spilled(folder, "control", samples.force(39), samples.force(41))
    spilled(folder, "camera", samples.frame(9))
    report = recover_recording(finished)
    assert not report.changed
    assert "1 of its messages are not in the closed recording" in report.problems[0]
    assert finished.read_bytes() == content
    assert sorted(path.name for path in folder.glob("unacknowledged*")) == [
        "unacknowledged-camera.mcap.merged",
        "unacknowledged-control.mcap.refused",
    ]
    assert recover_recording(finished).problems == ()


@pytest.mark.parametrize(
    ("metadata", "shift_s", "word"),
    [({"trial": "2"}, 0.0, "it is of trial 2"), ({"trial": "1"}, 9.0, "its messages are from")],
)
def test_a_spill_of_another_attempt_is_refused(
    finished: Path, samples: Any, metadata: dict[str, str], shift_s: float, word: str
) -> None:
    """By what it says of itself, or by its stamps, which lie after the attempt's end."""
    finished.write_bytes(finished.read_bytes()[:50_000])
    start_ns = samples.force(0).stamp_ns
    for name, stamp_ns in (("attempt-start", start_ns), ("attempt-end", start_ns + 10**9)):
        event = JournalEvent(stamp_ns=stamp_ns, name=name, trial=1, attempt=1)
        append_event(finished.parents[3] / "journal.jsonl", event)
    (finished.parents[3] / "run.json").write_text("{}", "utf-8")
    sample = samples.force(41)
    later = replace(sample, stamp_ns=sample.stamp_ns + round(shift_s * 1e9))
    spilled(finished.parent, "control", later, **metadata)
    report = recover_recording(finished)
    assert report.changed
    assert report.merged_count == 0
    assert word in report.problems[0]
    assert (finished.parent / "unacknowledged-control.mcap.refused").exists()


def test_a_recording_at_work_is_left_alone(tmp_path: Path, samples: Any) -> None:
    """Recovery does not touch a file that a writer still holds."""
    path = tmp_path / "recording.mcap"
    with RecordingWriter(path, metadata={}) as writer:
        writer.write([samples.force(0)])
        with pytest.raises(RecordError, match="is being written by a program") as caught:
            recover_recording(path)
        assert "wait for the run to end" in caught.value.remedy
        writer.write([samples.force(1)])
    assert Recording.open(path).message_count == 2


def test_recovery_on_a_full_disk_changes_nothing(
    finished: Path, file_size_limit: Callable[[int], AbstractContextManager[None]]
) -> None:
    """Without room for the new file, the old one and its folder stay as they were."""
    finished.write_bytes(torn := finished.read_bytes()[:50_000])
    with (
        file_size_limit(20_000),
        pytest.raises(RecordError, match=r"no space left to write.* up to 0\.1 MB") as caught,
    ):
        recover_recording(finished)
    assert "then recover again" in caught.value.remedy
    assert finished.read_bytes() == torn
    assert list(finished.parent.iterdir()) == [finished]


def test_a_whole_run_is_recovered(finished: Path) -> None:
    """Each attempt gets its report; one beyond repair does not stop the others."""
    root = finished.parents[3]
    paths = RunPaths(root)
    finished.write_bytes(finished.read_bytes()[:50_000])
    for trial, content in ((2, b""), (3, b"not a recording")):
        paths.attempt(trial, 1).mkdir(parents=True)
        paths.recording(trial, 1).write_bytes(content)
    paths.attempt(4, 1).mkdir(parents=True)
    reports = recover_recordings(root)
    assert [report.changed for report in reports] == [True, False, False]
    assert reports[0].problems == ()
    assert "the recording is empty" in reports[1].problems[0]
    assert "not an MCAP recording" in reports[2].problems[0]
