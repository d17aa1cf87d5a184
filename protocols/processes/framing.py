"""Entries of the record on their way from a producer to the recorder, framed on a stream."""

from __future__ import annotations

import pickle
import struct

from protocols.control.record import Entry

HEADER = struct.Struct("!IQ")


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
