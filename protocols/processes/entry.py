"""Entries of the record on their way from a producer to the recorder, framed on a stream."""

from __future__ import annotations

import pickle
import struct
from dataclasses import dataclass

from protocols.processes.record_keeper import RecordKeeper
from tacauchy_rig.run import ArmSample, ForceSample, ImageFrame, JournalEvent, TrialRecord

HEADER = struct.Struct("!IQ")


@dataclass(frozen=True, slots=True)
class Begin:
    """An attempt begins."""

    trial: int
    attempt: int


@dataclass(frozen=True, slots=True)
class Force:
    """Force samples."""

    samples: tuple[ForceSample, ...]


@dataclass(frozen=True, slots=True)
class Arm:
    """Arm states."""

    samples: tuple[ArmSample, ...]


@dataclass(frozen=True, slots=True)
class Frame:
    """A camera frame."""

    frame: ImageFrame


@dataclass(frozen=True, slots=True)
class Event:
    """A line of the journal."""

    event: JournalEvent


@dataclass(frozen=True, slots=True)
class End:
    """An attempt ended; frames up to ``stamp_ns`` belong to it."""

    record: TrialRecord
    stamp_ns: int


Entry = Begin | Force | Arm | Frame | Event | End


def keep(keeper: RecordKeeper, entry: Entry) -> None:
    """Hand an entry to a record keeper.

    Raises:
        RecordError: It cannot be written.
    """
    match entry:
        case Begin(trial=trial, attempt=attempt):
            keeper.begin_attempt(trial, attempt)
        case Force(samples=force):
            keeper.force(force)
        case Arm(samples=arm):
            keeper.arm(arm)
        case Frame(frame=frame):
            keeper.frame(frame)
        case Event(event=event):
            keeper.event(event)
        case End(record=record):
            keeper.end_attempt(record)


def encode(number: int, entry: Entry) -> bytes:
    """Return an entry with its number, ready for a stream."""
    body = pickle.dumps(entry, protocol=pickle.HIGHEST_PROTOCOL)
    return HEADER.pack(len(body), number) + body


class EntryReader:
    """Puts entries together again from whatever pieces a stream delivers."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, Entry]]:
        """Return (number, entry) of each entry that is complete now."""
        self._buffer += data
        entries: list[tuple[int, Entry]] = []
        offset = 0
        while len(self._buffer) - offset >= HEADER.size:
            size, number = HEADER.unpack_from(self._buffer, offset)
            start = offset + HEADER.size
            if len(self._buffer) < start + size:
                break
            body = self._buffer[start : start + size]
            entries.append((number, pickle.loads(body)))  # noqa: S301 - from our own producers
            offset = start + size
        del self._buffer[:offset]
        return entries
