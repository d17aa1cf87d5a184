"""Reading an MCAP file that may be unfinished or damaged: every whole message, and what is wrong.

``mcap``'s own readers refuse an unfinished file, return short messages at a torn end, and stop at
the first damaged byte.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Footer, Header, McapRecord, Metadata, Statistics
from mcap.writer import MCAP0_MAGIC

_RECORD_HEADER = struct.Struct("<BQ")
_CHUNK_HEADER = struct.Struct("<BQQQQIIQ")
_MESSAGE_HEADER = struct.Struct("<HIQQ")
# A chunk record whose sizes are below 2^40 and whose compression is the empty text.
_CHUNK_START = re.compile(rb"(?=\x06.{5}\x00{3}.{28}\x00{4}.{5}\x00{3})", re.DOTALL)
_SEARCH_BLOCK = 4 << 20
_SEARCHES = 16
_MAX_MESSAGES = 5_000_000
_LATEST_NS = 2**63 - 1
_MALFORMED = (McapError, struct.error, ValueError)
"""What its records raise where their checksums are right and their content is not."""
_DATA_END_SIZE = _RECORD_HEADER.size + 4
_MESSAGE_INDEX = struct.Struct("<HI")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Where the data of one message lie in the file [bytes], and its stamps [ns] and counter."""

    channel: int
    log_time: int
    publish_time: int
    sequence: int
    offset: int
    length: int


@dataclass(slots=True)
class Scan:
    """What was found in a file."""

    size: int  # of the file [bytes]
    has_magic: bool = False  # the file begins as every MCAP file does
    finished: bool = False  # the file was closed and its index is whole
    torn_bytes: int = 0  # bytes at the end that are no whole message: what a killed writer leaves
    entries: list[Entry] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, str] = field(default_factory=dict)
    # Damage, in words; empty for a file that is only unfinished
    problems: list[str] = field(default_factory=list)
    search_bytes: int = 0


def scan_file(descriptor: int) -> Scan:
    """Find every whole message of an open file, in the order in which they were written."""
    scan = Scan(size=os.fstat(descriptor).st_size)
    scan.search_bytes = _SEARCHES * scan.size
    scan.has_magic = os.pread(descriptor, len(MCAP0_MAGIC), 0) == MCAP0_MAGIC
    if not scan.has_magic and scan.size:
        scan.problems.append("the first bytes are not those of an MCAP file")
    limit, message_count = scan.size, 0
    for record in _read_summary(descriptor, scan.size):
        if isinstance(record, Channel):
            scan.channels[record.id] = record
        elif isinstance(record, Statistics):
            message_count = record.message_count
        elif isinstance(record, Footer):
            scan.finished, limit = True, record.summary_start - _DATA_END_SIZE
    _walk(descriptor, scan, limit=limit)
    if message_count > len(scan.entries):
        lost = message_count - len(scan.entries)
        scan.problems.append(f"{lost} of {message_count} messages are lost")
    return scan


def _walk(descriptor: int, scan: Scan, *, limit: int) -> None:
    offset = len(MCAP0_MAGIC)
    while offset < limit:
        end = _read_record(descriptor, scan, offset, limit)
        if len(scan.entries) > _MAX_MESSAGES:
            scan.problems.append(f"it holds more than {_MAX_MESSAGES} messages")
            return
        if end is not None:
            offset = end
            continue
        following = _find_chunk(descriptor, scan, offset + 1, limit)
        if following is None and not scan.finished:
            scan.torn_bytes = limit - offset
            return
        following = limit if following is None else following
        scan.problems.append(f"bytes {offset} to {following} are damaged")
        offset = following


def _read_record(descriptor: int, scan: Scan, offset: int, limit: int) -> int | None:
    """Take in the record at ``offset`` and return its end, or None if it is not whole."""
    header = os.pread(descriptor, _RECORD_HEADER.size, offset)
    if len(header) < _RECORD_HEADER.size:
        return None
    opcode, length = _RECORD_HEADER.unpack(header)
    start = offset + len(header)
    end: int = start + length
    if end > limit:
        return None
    if opcode == Opcode.CHUNK:
        chunk = _read_chunk(descriptor, offset, limit)
        if chunk is None:
            return None
        channels, entries = chunk
        scan.entries.extend(entries)
        scan.channels.update((channel.id, channel) for channel in channels)
        return end
    if opcode == Opcode.MESSAGE_INDEX:
        body = os.pread(descriptor, _MESSAGE_INDEX.size, start)
        is_whole = length >= len(body) and _MESSAGE_INDEX.unpack(body)[1] + len(body) == length
        return end if is_whole else None
    if opcode in (Opcode.METADATA, Opcode.HEADER):
        return end if _read_description(os.pread(descriptor, length, start), scan, opcode) else None
    if opcode == Opcode.DATA_END and length == _DATA_END_SIZE - _RECORD_HEADER.size:
        scan.problems.append("the index at its end is damaged")
        return limit
    return None


def _read_description(body: bytes, scan: Scan, opcode: int) -> bool:
    """Take in a header or metadata record, which has no checksum; True if its sizes agree."""
    stream = ReadDataStream(BytesIO(body))
    try:
        if opcode == Opcode.HEADER:
            Header.read(stream)
        else:
            scan.metadata.update(Metadata.read(stream).metadata)
    except _MALFORMED:
        return False
    return stream.count == len(body)


def _read_summary(descriptor: int, size: int) -> list[McapRecord]:
    """Return the records at the end of a file that was closed, the footer the last; else none."""
    end = size - len(MCAP0_MAGIC) - FOOTER_SIZE
    if end < 0:
        return []
    tail = os.pread(descriptor, size - end, end)
    if tail[FOOTER_SIZE:] != MCAP0_MAGIC:
        return []
    if _RECORD_HEADER.unpack_from(tail) != (Opcode.FOOTER, FOOTER_SIZE - _RECORD_HEADER.size):
        return []
    footer = Footer.read(ReadDataStream(BytesIO(tail[_RECORD_HEADER.size :])))
    if not 0 < footer.summary_start <= end:
        return []
    body = os.pread(descriptor, end - footer.summary_start, footer.summary_start)
    if zlib.crc32(tail[: FOOTER_SIZE - 4], zlib.crc32(body)) != footer.summary_crc:
        return []
    try:
        return [*_summarised(body), footer]
    except _MALFORMED:
        return []


def _summarised(body: bytes) -> Iterator[McapRecord]:
    """Yield channels and statistics of a summary; its index of every chunk is left out."""
    readers: dict[int, Callable[[ReadDataStream], McapRecord]] = {
        Opcode.CHANNEL: Channel.read,
        Opcode.STATISTICS: Statistics.read,
    }
    for opcode, start, end in _records(body):
        if opcode in readers:
            yield readers[opcode](ReadDataStream(BytesIO(body[start:end])))


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the content of each record; the last may be cut off."""
    end = 0
    while end + _RECORD_HEADER.size <= len(data):
        opcode, length = _RECORD_HEADER.unpack_from(data, end)
        start = end + _RECORD_HEADER.size
        end = start + length
        yield opcode, start, end


def _read_chunk(
    descriptor: int, offset: int, limit: int
) -> tuple[list[Channel], list[Entry]] | None:
    """Read the chunk at ``offset``, or return None if no whole one ends before ``limit``."""
    header = os.pread(descriptor, _CHUNK_HEADER.size, offset)
    if len(header) < _CHUNK_HEADER.size:
        return None
    opcode, length, _, _, size, checksum, compression, stored = _CHUNK_HEADER.unpack(header)
    end = offset + _RECORD_HEADER.size + length
    is_consistent = (
        opcode == Opcode.CHUNK
        and compression == 0
        and size == stored
        and length == stored + _CHUNK_HEADER.size - _RECORD_HEADER.size
        and end <= limit
    )
    if not is_consistent:
        return None
    data = os.pread(descriptor, stored, offset + _CHUNK_HEADER.size)
    if len(data) != stored or zlib.crc32(data) != checksum:
        return None
    try:
        return _contents(data, start=offset + _CHUNK_HEADER.size)
    except _MALFORMED:
        return None


def _find_chunk(descriptor: int, scan: Scan, offset: int, limit: int) -> int | None:
    """Return where the next whole chunk at or after ``offset`` starts, or None.

    Bytes that look like many long chunks are not all tried: the work stays a multiple of the size.
    """
    for candidate in _candidates(descriptor, offset, limit):
        header = os.pread(descriptor, _CHUNK_HEADER.size, candidate)
        scan.search_bytes -= min(_CHUNK_HEADER.unpack(header)[-1], limit) if header else 0
        if scan.search_bytes < 0:
            return None
        if _read_chunk(descriptor, candidate, limit) is not None:
            return candidate
    return None


def _candidates(descriptor: int, offset: int, limit: int) -> Iterator[int]:
    while offset < limit:
        block = os.pread(descriptor, _SEARCH_BLOCK + _CHUNK_HEADER.size - 1, offset)
        for match in _CHUNK_START.finditer(block):
            if match.start() < _SEARCH_BLOCK:
                yield offset + match.start()
        offset += _SEARCH_BLOCK


def _contents(data: bytes, *, start: int) -> tuple[list[Channel], list[Entry]] | None:
    """Return channels and messages of a chunk whose content is at ``start`` in the file."""
    channels, entries, end = [], [], 0
    for opcode, position, end in _records(data):
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE_HEADER.unpack_from(data, position)
            length = end - position - _MESSAGE_HEADER.size
            if max(log_time, publish_time) > _LATEST_NS or length < 0:
                return None
            entry = Entry(
                channel=channel,
                log_time=log_time,
                publish_time=publish_time,
                sequence=sequence,
                offset=start + position + _MESSAGE_HEADER.size,
                length=length,
            )
            entries.append(entry)
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(ReadDataStream(BytesIO(data[position:end]))))
    return (channels, entries) if end == len(data) else None
