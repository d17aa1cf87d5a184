"""One chunk of a recording: is it whole, what is in it, and where is the next whole one."""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel

RECORD_HEADER = struct.Struct("<BQ")
_CHUNK_HEADER = struct.Struct("<BQQQQIIQ")
_MESSAGE_HEADER = struct.Struct("<HIQQ")
# A chunk record whose sizes are below 2^40 and whose compression is the empty text.
_CHUNK_START = re.compile(rb"(?=\x06.{5}\x00{3}.{28}\x00{4}.{5}\x00{3})", re.DOTALL)
_SEARCH_BLOCK = 4 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Where one message lies.

    Attributes:
        log_time: Arrival stamp [ns].
        publish_time: The device's stamp [ns], or ``log_time``.
        sequence: The device's counter, modulo 2^32.
        offset: Of the message's data in the file [bytes].
        length: Of the message's data [bytes].
    """

    channel: int
    log_time: int
    publish_time: int
    sequence: int
    offset: int
    length: int


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeChunk:
    """A chunk whose checksum agrees.

    Attributes:
        end: Offset of the first byte after it.
    """

    end: int
    channels: tuple[Channel, ...]
    entries: tuple[Entry, ...]


def read_chunk(descriptor: int, offset: int, limit: int) -> WholeChunk | None:
    """Read the chunk at ``offset``, or return None if no whole one ends before ``limit``."""
    header = os.pread(descriptor, _CHUNK_HEADER.size, offset)
    if len(header) < _CHUNK_HEADER.size:
        return None
    opcode, length, _, _, size, checksum, compression, stored = _CHUNK_HEADER.unpack(header)
    end = offset + RECORD_HEADER.size + length
    is_consistent = (
        opcode == Opcode.CHUNK
        and compression == 0
        and size == stored
        and length == stored + _CHUNK_HEADER.size - RECORD_HEADER.size
        and end <= limit
    )
    if not is_consistent:
        return None
    data = os.pread(descriptor, stored, offset + _CHUNK_HEADER.size)
    if len(data) != stored or zlib.crc32(data) != checksum:
        return None
    return _contents(data, start=offset + _CHUNK_HEADER.size, end=end)


def find_chunk(descriptor: int, offset: int, limit: int) -> int | None:
    """Return where the next whole chunk at or after ``offset`` starts, or None."""
    for candidate in _candidates(descriptor, offset, limit):
        if read_chunk(descriptor, candidate, limit) is not None:
            return candidate
    return None


def _candidates(descriptor: int, offset: int, limit: int) -> Iterator[int]:
    while offset < limit:
        block = os.pread(descriptor, _SEARCH_BLOCK + _CHUNK_HEADER.size - 1, offset)
        for match in _CHUNK_START.finditer(block):
            if match.start() < _SEARCH_BLOCK:
                yield offset + match.start()
        offset += _SEARCH_BLOCK


def _contents(data: bytes, *, start: int, end: int) -> WholeChunk | None:
    channels, entries, position = [], [], 0
    while position + RECORD_HEADER.size <= len(data):
        opcode, length = RECORD_HEADER.unpack_from(data, position)
        position += RECORD_HEADER.size
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE_HEADER.unpack_from(data, position)
            entry = Entry(
                channel=channel,
                log_time=log_time,
                publish_time=publish_time,
                sequence=sequence,
                offset=start + position + _MESSAGE_HEADER.size,
                length=length - _MESSAGE_HEADER.size,
            )
            entries.append(entry)
        elif opcode == Opcode.CHANNEL:
            channels.append(
                Channel.read(ReadDataStream(BytesIO(data[position : position + length])))
            )
        position += length
    if position != len(data):
        return None
    return WholeChunk(end=end, channels=tuple(channels), entries=tuple(entries))
