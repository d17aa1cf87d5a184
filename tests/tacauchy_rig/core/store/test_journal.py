"""The journal: whole lines, on the disk, and readable whatever a crash left."""

from __future__ import annotations

import fcntl
import multiprocessing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.durable import bytes_sha256
from tacauchy_rig.core.store.journal import Journal, append_event, read_journal

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


def _event(number: int) -> JournalEvent:
    return JournalEvent(stamp_ns=number, name="phase", trial=1, attempt=1, detail={"n": number})


@given(name=st.text(), detail=st.dictionaries(st.text(), JSON), stamp=st.integers(0, 2**62))
def test_any_event_comes_back(
    tmp_path_factory: pytest.TempPathFactory, name: str, detail: dict[str, object], stamp: int
) -> None:
    """Names and details of any text, newlines included, survive; infinities become text."""
    path = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    event = JournalEvent(stamp_ns=stamp, name=name, detail=detail)
    append_event(path, event)
    append_event(path, _event(1))
    first, second = read_journal(path)
    assert second == _event(1)
    assert (first.stamp_ns, first.name, len(first.detail)) == (stamp, name, len(detail))
    assert path.read_bytes().count(b"\n") == 2


@pytest.mark.parametrize("cut", [1, 2, 20, 60])
def test_half_a_line_is_passed_over_and_the_next_is_whole(tmp_path: Path, cut: int) -> None:
    """A crash in the middle of a line costs that line only, also after the run was resumed."""
    path = tmp_path / "journal.jsonl"
    for number in range(3):
        append_event(path, _event(number))
    path.write_bytes(path.read_bytes()[:-cut])
    kept = read_journal(path)
    assert kept == [_event(number) for number in range(3 if cut == 1 else 2)]
    append_event(path, _event(3))
    assert read_journal(path) == [*kept, _event(3)]


def test_empty_lines_that_a_power_cut_left_are_not_counted(tmp_path: Path) -> None:
    """Stale bytes may hold line breaks; the lines after them are numbered as they are read."""
    path = tmp_path / "journal.jsonl"
    append_event(path, _event(0))
    path.write_bytes(path.read_bytes() + b"\xff\n\n\xfe")
    append_event(path, _event(1))
    assert [line.number for line in Journal.read(path).lines] == [1, None, None, 4]


def _append_many(path: Path, first: int) -> None:
    for number in range(first, first + 50):
        append_event(path, _event(number))


def test_lines_of_several_processes_do_not_mix(tmp_path: Path) -> None:
    """Two processes that append at once lose and mix nothing."""
    path = tmp_path / "journal.jsonl"
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_append_many, args=(path, n)) for n in (0, 1000)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    stamps = [event.stamp_ns for event in read_journal(path)]
    assert sorted(stamps) == [*range(50), *range(1000, 1050)]
    assert [stamp for stamp in stamps if stamp < 1000] == list(range(50))


def test_a_full_disk_is_said() -> None:
    """The device that is always full gives the message of a full disk."""
    with pytest.raises(RecordError, match="/dev/full: no space left to write") as caught:
        append_event(Path("/dev/full"), _event(0))
    assert "free some space" in caught.value.remedy


def test_a_line_that_is_no_event(tmp_path: Path) -> None:
    """A whole line that is something else is named with its number and field."""
    path = tmp_path / "journal.jsonl"
    append_event(path, _event(0))
    with path.open("a") as file:
        file.write('{"stamp_ns": 1, "nome": "phase"}\n')
    with pytest.raises(RecordError, match=r"journal\.jsonl line 2: nome: unknown field"):
        read_journal(path)


def test_each_line_is_numbered_and_holds_the_hash_of_the_one_before(tmp_path: Path) -> None:
    """The chain goes through half a line that a crash left, too."""
    path = tmp_path / "journal.jsonl"
    for number in range(3):
        append_event(path, _event(number))
    path.write_bytes(path.read_bytes()[:-20])
    append_event(path, _event(3))
    lines = Journal.read(path).lines
    assert [line.number for line in lines] == [1, 2, None, 4]
    hashes = [bytes_sha256(line.raw) for line in lines]
    assert [line.previous for line in lines] == ["", hashes[0], None, hashes[2]]


def test_a_journal_that_another_process_holds_is_said(tmp_path: Path) -> None:
    """A writer that never lets go holds nobody up for long."""
    path = tmp_path / "journal.jsonl"
    append_event(path, _event(0))
    with path.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(RecordError, match=r"another process has held it for 1 s"):
            append_event(path, _event(1))
    append_event(path, _event(1))
    assert len(read_journal(path)) == 2
