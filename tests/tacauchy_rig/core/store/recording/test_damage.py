"""Unfinished, torn, flipped, cut and foreign files: what is readable is read, the rest is said."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, RecordingWriter, Topic

FRAME_COUNT = 6


@dataclass(frozen=True)
class Original:
    """A recording's bytes, the file's size after each call, and its messages."""

    unfinished: bytes
    finished: bytes
    acknowledged: list[tuple[int, int]]
    messages: list[RawMessage]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for files that one test rewrites many times."""
    return tmp_path_factory.mktemp("damage")


@pytest.fixture(scope="module")
def original(folder: Path, samples: Any) -> Original:
    """Return a small recording before and after it was closed."""
    path = folder / "original.mcap"
    writer = RecordingWriter(path, metadata={"trial": "1"})
    acknowledged = [(path.stat().st_size, 0)]
    for number in range(FRAME_COUNT):
        writer.write([samples.frame(number, size=90)])
        acknowledged.append((path.stat().st_size, writer.message_count))
        writer.write([samples.force(2 * number), samples.force(2 * number + 1)])
        acknowledged.append((path.stat().st_size, writer.message_count))
    unfinished = path.read_bytes()
    writer.close()
    messages = list(Recording.open(path).raw_messages())
    return Original(unfinished, path.read_bytes(), acknowledged, messages)


def _opened(folder: Path, data: bytes) -> Recording:
    path = folder / "recording.mcap"
    path.write_bytes(data)
    return Recording.open(path)


def _contents(messages: Iterable[RawMessage]) -> set[tuple[Topic, int, int, bytes]]:
    return {(each.topic, each.log_time, each.sequence, each.data) for each in messages}


@given(data=st.data())
def test_a_cut_file_gives_every_message_before_the_cut(
    folder: Path, original: Original, data: st.DataObject
) -> None:
    """Wherever a file ends, the messages whose call had returned by then are readable."""
    length = data.draw(st.integers(original.acknowledged[0][0], len(original.unfinished)))
    recording = _opened(folder, original.unfinished[:length])
    due = max(count for size, count in original.acknowledged if size <= length)
    assert recording.message_count >= due
    assert not recording.finished
    assert recording.damage == ""
    assert set(recording.raw_messages()) <= set(original.messages)


@pytest.mark.parametrize("finished", [False, True])
def test_a_flipped_bit_never_changes_a_value(
    folder: Path, original: Original, *, finished: bool
) -> None:
    """Wherever a bit flips, at most one message is lost, none silently, and none is altered."""
    content = bytearray(original.finished if finished else original.unfinished)
    written = _contents(original.messages)
    for offset in range(0, len(content), 7):
        content[offset] ^= 1 << offset % 8
        recording = _opened(folder, bytes(content))
        content[offset] ^= 1 << offset % 8
        messages = _contents(recording.raw_messages())
        lost = len(written - messages)
        assert lost <= 1, offset
        assert not lost or recording.damage or recording.torn_bytes, offset
        assert messages <= written, offset


@given(start=st.integers(0, 5000), length=st.integers(1, 2000), fill=st.binary(min_size=1))
def test_a_hole_costs_only_what_it_covers(
    folder: Path, original: Original, start: int, length: int, fill: bytes
) -> None:
    """Messages before and after an overwritten stretch are kept."""
    content = bytearray(original.finished)
    end = min(start + length, len(content))
    content[start:end] = (fill * length)[: end - start]
    recording = _opened(folder, bytes(content))
    touched = sum(
        1
        for (low, _), (high, _) in zip(
            original.acknowledged, original.acknowledged[1:], strict=False
        )
        if start < high and end > low
    )
    assert recording.message_count >= len(original.messages) - 2 * touched
    assert {message.data for message in recording.raw_messages()} <= {
        message.data for message in original.messages
    }


def test_a_hole_in_the_middle_is_described(folder: Path, original: Original) -> None:
    """It is said which bytes are damaged, what is lost and what is readable."""
    content = bytearray(original.finished)
    force = next(each for each in original.messages if each.topic is Topic.FORCE)
    hole = content.index(force.data)
    content[hole : hole + 10] = bytes(10)
    recording = _opened(folder, bytes(content))
    assert recording.finished
    assert not recording.is_intact
    message = recording.describe()
    assert f"damaged: bytes {hole // 1000}" in message
    assert f"1 of {len(original.messages)} messages are lost" in message
    assert f"{len(original.messages) - 1} messages over 0." in message
    assert "(force 11, arm 0, event 0, image 6)" in message


def test_an_unfinished_recording_is_described(tmp_path: Path, original: Original) -> None:
    """A recording whose writer was killed says how much is readable."""
    path = tmp_path / "recording.mcap"
    path.write_bytes(original.unfinished[:-50])
    recording = Recording.open(path)
    assert not recording.is_intact
    message = recording.describe()
    assert "unfinished (its writer was killed or is at work)" in message
    assert "its last 123 bytes are torn" in message
    assert f"{len(original.messages) - 1} messages over 0.20 s are readable" in message


def test_a_tail_of_zeros_is_a_torn_end(folder: Path, original: Original) -> None:
    """What a file system leaves after losing power costs no message."""
    recording = _opened(folder, original.unfinished + bytes(100_000))
    assert recording.message_count == len(original.messages)
    assert (recording.torn_bytes, recording.damage) == (100_000, "")


def test_damage_to_the_list_of_channels(folder: Path, original: Original) -> None:
    """With the first chunk gone, and so the names of the channels, the others are still read."""
    content = bytearray(original.unfinished)
    content[original.acknowledged[0][0] + 60] ^= 0xFF
    recording = _opened(folder, bytes(content))
    assert recording.force.counter.tolist() == list(range(2 * FRAME_COUNT))
    assert recording.frame_stamps()[1].tolist() == list(range(1, FRAME_COUNT))
    assert recording.damage.startswith("bytes ")


def test_an_empty_file(tmp_path: Path) -> None:
    """Nothing can be recovered from zero bytes; the remedy is to press again."""
    path = tmp_path / "recording.mcap"
    path.touch()
    with pytest.raises(RecordError, match=r"recording\.mcap: the recording is empty") as caught:
        Recording.open(path)
    assert "tacauchy-rig resume" in caught.value.remedy


@pytest.mark.parametrize("content", [b"GIF89a" + bytes(5000), b"x", b"\x06" * 10_000])
def test_a_foreign_file(tmp_path: Path, content: bytes) -> None:
    """A file that never was a recording is called that."""
    path = tmp_path / "recording.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=f"not an MCAP recording: {len(content)} bytes"):
        Recording.open(path)


def test_an_mcap_file_of_another_program(tmp_path: Path) -> None:
    """A recording of something else is refused by the names of its topics."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(topic="/tf", message_encoding="json", schema_id=0)
        writer.add_message(channel_id=channel, log_time=1, publish_time=1, data=b"{}")
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(RecordError, match=r"other\.mcap: holds /tf, which this program never"):
        Recording.open(path)


def test_a_missing_file(tmp_path: Path) -> None:
    """A missing recording is named."""
    with pytest.raises(RecordError, match=r"absent\.mcap: the recording is missing"):
        Recording.open(tmp_path / "absent.mcap")


@pytest.mark.usefixtures("unprivileged")
def test_no_permission_to_read() -> None:
    """A file that may not be read says who can change that."""
    with pytest.raises(RecordError, match="/etc/shadow: no permission to read the rec") as caught:
        Recording.open(Path("/etc/shadow"))
    assert "ask the owner" in caught.value.remedy
