"""``journal.jsonl``: one line for each change of state, on the disk before the run goes on.

Every line has its number and the SHA-256 of the line before it, so that a line that is taken out,
doubled, moved or edited afterwards shows.
"""

import fcntl
import json
import logging
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store import atomic_write
from tacauchy_rig.core.store.json_codec import dumps, loads, read_json, read_value, to_json
from tacauchy_rig.core.store.run_files import read_bytes

logger = logging.getLogger(__name__)

START, END = "run-start", "run-end"
_NUMBER, _PREVIOUS = "number", "previous"
_LOCK_TIMEOUT_S = 1.0
"""A writer holds the journal for as long as it takes to read and to append: about a millisecond."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalLine:
    """A line as it stands in the file."""

    raw: bytes  # its bytes, without the newline
    number: object = None  # the number written in it; None in half a line
    previous: object = None  # SHA-256 of the line before it, as written in it
    event: JournalEvent | None = None  # None for half a line, which a crash leaves


def append_event(path: Path, event: JournalEvent) -> None:
    """Append one line and bring it to the disk.

    The line goes out in one write while the file is locked, so lines of several processes never
    mix. Where a crash or a full disk left half a line behind, the new one starts on its own.

    Raises:
        RecordError: The disk is full, or the journal cannot be written.
    """
    with atomic_write.writing(path):
        is_new = not path.exists()
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            _lock(path, descriptor)
            before = os.pread(descriptor, os.fstat(descriptor).st_size, 0)
            line = _following(before, event)
            written = os.write(descriptor, line)
            fcntl.flock(descriptor, fcntl.LOCK_UN)  # a slow disk must hold nobody up
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        if is_new:
            atomic_write.sync_folder(path.parent)
    if written != len(line):
        raise RecordError(
            f"{path}: only {written} of {len(line)} bytes of a line could be written",
            remedy="free some space on that disk; the journal stays readable",
        )


def _parsed(raw: bytes, source: str) -> JournalLine:
    try:
        content = loads(raw, source=source)
    except RecordError:
        logger.warning("%s: incomplete, left by a crash; passed over", source)
        return JournalLine(raw=raw)
    links: dict[str, Any] = {}
    if isinstance(content, dict):
        links = {name: content.pop(name, None) for name in (_NUMBER, _PREVIOUS)}
    return JournalLine(raw=raw, event=read_value(JournalEvent, content, source=source), **links)


def _following(before: bytes, event: JournalEvent) -> bytes:
    """Return the bytes to append after ``before``: a newline first if that ends in half a line."""
    is_torn = bool(before) and not before.endswith(b"\n")
    lines = [line for line in before.split(b"\n") if line]  # as ``Journal.read`` counts them
    content = {
        _NUMBER: len(lines) + 1,
        _PREVIOUS: atomic_write.bytes_sha256(lines[-1]) if lines else "",
        **to_json(event),
    }
    text = json.dumps(content, ensure_ascii=False, allow_nan=False)
    return b"\n" * is_torn + f"{text}\n".encode()


def _lock(path: Path, descriptor: int) -> None:
    """Lock the journal against other writers; closing the descriptor lets go of it."""
    deadline = time.monotonic() + _LOCK_TIMEOUT_S
    while True:
        try:
            return fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() > deadline:
                raise RecordError(
                    f"{path}: another process has held it for {_LOCK_TIMEOUT_S:g} s",
                    remedy=f"see which one: `fuser -v {path}`",
                ) from error
            time.sleep(0.001)


class StoreEvent(StrEnum):
    """Events that the store writes into the journal itself.

    Attributes:
        WRITTEN: A file of the run as a whole is about to be written.
        SEALED: The result of an attempt was written.
        RECOVERED: A recording was repacked.
        CUT_OFF: The session before ended without a word; with a trial and an attempt, what is
            left of that attempt is no longer what its result said, which was set aside.
        REPLAYED: A replay was written.
    """

    WRITTEN = "written"
    SEALED = "sealed"
    RECOVERED = "recovered"
    CUT_OFF = "cut-off"
    REPLAYED = "replayed"


@dataclass(frozen=True)
class Journal:
    """A run's journal as it was read."""

    # As they stand in the file, half ones included, but not those that are empty
    lines: Sequence[JournalLine]
    exists: bool = True  # false where the file is missing

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a journal, which a run that never began does not have.

        Raises:
            RecordError: It is unreadable, or has a whole line that is no event.
        """
        if not path.exists():
            return cls((), exists=False)
        numbered = enumerate(read_bytes(path, what="the journal").split(b"\n"), start=1)
        return cls([_parsed(raw, f"{path} line {number}") for number, raw in numbered if raw])

    @cached_property
    def events(self) -> list[JournalEvent]:
        """Every whole line, oldest first; half a line that a crash left is passed over."""
        return [line.event for line in self.lines if line.event is not None]

    @property
    def head(self) -> str:
        """SHA-256 of the last line, which stands for the whole run; empty without a journal."""
        return atomic_write.bytes_sha256(self.lines[-1].raw) if self.lines else ""

    @property
    def is_open(self) -> bool:
        """True where the last session has no end: it runs, or was cut off."""
        return self._ends[-1:] == [START]

    @property
    def was_cut(self) -> bool:
        """True where a session was cut off, said or not."""
        return StoreEvent.CUT_OFF in self._ends or (START, START) in pairwise(self._ends)

    @property
    def may_lack_lines(self) -> bool:
        """True where a crash may have come between a file and the line about it."""
        return self.is_open or self.was_cut

    @cached_property
    def _ends(self) -> list[str]:
        """Names of the events that begin or end a session."""
        names = (START, END, StoreEvent.CUT_OFF)
        return [e.name for e in self.events if e.name in names and not e.trial]

    def store_events(
        self, name: StoreEvent, *, trial: int = 0, attempt: int = 0
    ) -> list[JournalEvent]:
        """Return the events of a kind about an attempt, or about the whole run."""
        wanted = (name, trial, attempt)
        return [e for e in self.events if (e.name, e.trial, e.attempt) == wanted]

    def of_attempt(self, trial: int, attempt: int) -> list[JournalEvent]:
        """Return what the protocol wrote of an attempt."""
        own = [e for e in self.events if (e.trial, e.attempt) == (trial, attempt)]
        return [e for e in own if e.name not in set(StoreEvent)]


def log_hashes(
    journal: Path, kind: StoreEvent, *, trial: int = 0, attempt: int = 0, **detail: Any
) -> None:
    """Write a line of the journal about a file of the run; errors as for ``append_event``."""
    event = JournalEvent(
        stamp_ns=time.monotonic_ns(), name=kind.value, trial=trial, attempt=attempt, detail=detail
    )
    append_event(journal, event)


T = TypeVar("T")


class HashedFile(Generic[T]):
    """A file of the run as a whole, whose hash is in the journal.

    What it writes raises RecordError where the disk is full or gone.
    """

    def __init__(self, path: Path, kind: type[T], journal: Path, what: str) -> None:
        self._path, self._kind, self._journal, self._what = path, kind, journal, what

    def load(self) -> T | None:
        """Read it; None where it was never written. RecordError where it is damaged."""
        if not self._path.exists():
            return None
        return read_json(self._kind, self._path, what=self._what)

    def save(self, value: T) -> None:
        """Write it, or write it anew."""
        self.write(dumps(value))

    def write(self, content: bytes) -> None:
        """Write its bytes, and their hash into the journal; the content before is kept beside it.

        The line goes out first: a crash between the two leaves the file that an earlier line told
        of.
        """
        self._log(atomic_write.bytes_sha256(content))
        if self._path.exists() and not self.damage():
            previous = previous_of(self._path)
            with atomic_write.writing(previous):
                previous.unlink(missing_ok=True)
                atomic_write.give_second_name(self._path, previous)
        atomic_write.write_atomically(self._path, content)

    def _log(self, sha256: str | None) -> None:
        log_hashes(self._journal, StoreEvent.WRITTEN, file=self._path.name, sha256=sha256)

    def damage(self) -> str:
        """Return why it cannot be read; an empty text where it can, or was never written."""
        try:
            self.load()
        except RecordError as error:
            return error.message
        return ""

    def mend(self) -> None:
        """Set it aside if it cannot be read, and take the content before, if there is any."""
        previous, sha256 = previous_of(self._path), None
        is_lost = not self._path.exists() and previous.exists()
        if not is_lost and not self.damage():
            return
        if not is_lost:
            atomic_write.set_aside(self._path, "torn")
        before = HashedFile(previous, self._kind, self._journal, self._what)
        if previous.exists() and not before.damage():
            content = read_bytes(previous, what=self._what)
            atomic_write.write_atomically(self._path, content)
            sha256 = atomic_write.bytes_sha256(content)
        self._log(sha256)


def previous_of(path: Path) -> Path:
    """Return where the content lies that a file of the run had before it was written anew."""
    return path.with_name(f"{path.name}.previous")
