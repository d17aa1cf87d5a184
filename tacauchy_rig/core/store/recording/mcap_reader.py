"""Reading a recording back, finished or not, whole or damaged, and saying what is wrong.

``mcap``'s own readers refuse an unfinished file, return short messages at a torn end, and stop at
the first damaged byte.
"""

import math
import os
import re
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, Self

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Footer, Header, McapRecord, Metadata, Statistics
from mcap.writer import MCAP0_MAGIC

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.run import ImageFrame, JournalEvent
from tacauchy_rig.core.store.recording.mcap_writer import (
    ARM_STATES,
    POSE_FIELDS,
    TCP_FORCE_FIELDS,
    VELOCITY_FIELDS,
    WRENCH_FIELDS,
    RawMessage,
    Topic,
    decode,
    decode_event,
    decode_jpeg,
)
from tacauchy_rig.core.store.run_files import open_file, run_root_of

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
_SUMMARISED: dict[int, type[Channel | Statistics]] = {
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
}
"""What is read of a summary; its index of every chunk is left out."""
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


class Scan:
    """What is found in an open file: every whole message, in the order of the file.

    Attributes:
        size: Of the file [bytes].
        has_magic: It begins as every MCAP file does.
        finished: It was closed by its writer and its index is whole: public viewers can open it.
        torn_bytes: Bytes at the end of an unfinished file that are no whole message.
        metadata: What the writer was told about the attempt.
        problems: What is wrong with it beside being unfinished, in words.
    """

    def __init__(self, descriptor: int) -> None:
        self.size = os.fstat(descriptor).st_size
        self.has_magic = os.pread(descriptor, len(MCAP0_MAGIC), 0) == MCAP0_MAGIC
        self.finished, self.torn_bytes = False, 0
        self.entries: list[Entry] = []
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, str] = {}
        self.problems: list[str] = []
        self._descriptor, self._search_bytes = descriptor, _SEARCHES * self.size
        if not self.has_magic and self.size:
            self.problems.append("the first bytes are not those of an MCAP file")
        limit, message_count = self.size, 0
        for record in _read_summary(descriptor, self.size):
            if isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Statistics):
                message_count = record.message_count
            elif isinstance(record, Footer):
                self.finished, limit = True, record.summary_start - _DATA_END_SIZE
        self._walk(limit)
        if message_count > len(self.entries):
            lost = message_count - len(self.entries)
            self.problems.append(f"{lost} of {message_count} messages are lost")

    def _walk(self, limit: int) -> None:
        offset = len(MCAP0_MAGIC)
        while offset < limit:
            end = self._read_record(offset, limit)
            if len(self.entries) > _MAX_MESSAGES:
                self.problems.append(f"it holds more than {_MAX_MESSAGES} messages")
                return
            if end is not None:
                offset = end
                continue
            following = self._find_chunk(offset + 1, limit)
            if following is None and not self.finished:
                self.torn_bytes = limit - offset
                return
            following = limit if following is None else following
            self.problems.append(f"bytes {offset} to {following} are damaged")
            offset = following

    def _read_record(self, offset: int, limit: int) -> int | None:
        """Take in the record at ``offset`` and return its end, or None if it is not whole."""
        header = os.pread(self._descriptor, _RECORD_HEADER.size, offset)
        if len(header) < _RECORD_HEADER.size:
            return None
        opcode, length = _RECORD_HEADER.unpack(header)
        start = offset + len(header)
        end: int = start + length
        if end > limit:
            return None
        if opcode == Opcode.CHUNK:
            if (chunk := _read_chunk(self._descriptor, offset, limit)) is None:
                return None
            self.channels.update((channel.id, channel) for channel in chunk[0])
            self.entries += chunk[1]
            return end
        if opcode == Opcode.MESSAGE_INDEX:
            body = os.pread(self._descriptor, _MESSAGE_INDEX.size, start)
            is_whole = length >= len(body) and _MESSAGE_INDEX.unpack(body)[1] + len(body) == length
            return end if is_whole else None
        if opcode in (Opcode.METADATA, Opcode.HEADER):
            body = os.pread(self._descriptor, length, start)
            return end if self._read_description(body, opcode) else None
        if opcode == Opcode.DATA_END and length == _DATA_END_SIZE - _RECORD_HEADER.size:
            self.problems.append("the index at its end is damaged")
            return limit
        return None

    def _read_description(self, body: bytes, opcode: int) -> bool:
        """Take in a header or metadata record, which has no checksum; True if its sizes agree."""
        stream = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.HEADER:
                Header.read(stream)
            else:
                self.metadata.update(Metadata.read(stream).metadata)
        except _MALFORMED:
            return False
        return stream.count == len(body)

    def _find_chunk(self, offset: int, limit: int) -> int | None:
        """Return where the next whole chunk at or after ``offset`` starts, or None.

        Bytes that look like many long chunks are not all tried: the work stays a multiple of the
        size.
        """
        for start in range(offset, limit, _SEARCH_BLOCK):
            block = os.pread(self._descriptor, _SEARCH_BLOCK + _CHUNK_HEADER.size - 1, start)
            for match in _CHUNK_START.finditer(block):
                candidate = start + match.start()
                header = os.pread(self._descriptor, _CHUNK_HEADER.size, candidate)
                self._search_bytes -= min(_CHUNK_HEADER.unpack(header)[-1], limit) if header else 0
                if self._search_bytes < 0:
                    return None
                if _read_chunk(self._descriptor, candidate, limit) is not None:
                    return candidate
        return None


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
        return [
            _SUMMARISED[opcode].read(ReadDataStream(BytesIO(body[start:end])))
            for opcode, start, end in _records(body)
            if opcode in _SUMMARISED
        ] + [footer]
    except _MALFORMED:
        return []


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


# Numbers that RecordingWriter gives to its channels, for files whose own list is damaged.
_USUAL_CHANNELS = {1: Topic.FORCE, 2: Topic.ARM, 3: Topic.EVENT}


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceArrays:
    """The force stream as recorded: raw, no tare, no sign."""

    stamp_ns: Int64Array  # arrival on this host [ns], shape [n]
    counter: Int64Array  # the box's package number, unwrapped, shape [n]
    wrench: FloatArray  # Fx, Fy, Fz [N], Mx, My, Mz [N m], shape [n, 6]

    def between(self, start_ns: int | None, end_ns: int | None) -> FloatArray:
        """Return the wrenches of a window, both ends included, shape [m, 6]; empty without one."""
        if start_ns is None or end_ns is None:
            return np.empty((0, 6))
        return self.wrench[(self.stamp_ns >= start_ns) & (self.stamp_ns <= end_ns)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmArrays:
    """The arm's states as recorded."""

    stamp_ns: Int64Array  # when this host read the state [ns], shape [n]
    controller_time_s: FloatArray  # the controller's own stamp [s], shape [n]
    # x, y, z [m], rotation vector [rad] of the tip in the base frame, shape [n, 6]
    pose: FloatArray
    velocity: FloatArray  # tool velocity [m/s, rad/s], shape [n, 6]
    # The arm's own estimate of force [N] and moment [N m] on its tool, base frame, not tared, shape
    # [n, 6]; NaN where it gave none
    tcp_force: FloatArray
    safety_bits: Int64Array  # RTDE safety_status_bits, shape [n]
    runtime_state: Int64Array  # RTDE runtime_state, shape [n]
    robot_mode: Int64Array  # RTDE robot_mode, shape [n]


class Recording(Scan):
    """One attempt's streams. What it returns passed its checksums when it was opened.

    Attributes:
        path: The MCAP file.
        damage: What is wrong with it beside being unfinished, in words; empty if nothing is.
        message_count: Readable messages.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        super().__init__(descriptor)
        self.path, self.message_count = path, len(self.entries)
        self.damage = "; ".join(self.problems)
        if self.size == 0:
            raise RecordError(
                f"{path}: the recording is empty (0 bytes): its writer ended before its first "
                "write, so nothing can be recovered",
                remedy=f"`{command_line('resume', run_root_of(path))}` presses this trial again",
            )
        if not self.has_magic and not self.entries:
            raise RecordError(
                f"{path}: not an MCAP recording: {self.size} bytes, and no whole message in them",
                remedy="check the path; the file was replaced, or its disk is failing",
            )
        if foreign := {channel.topic for channel in self.channels.values()} - set(Topic):
            raise RecordError(
                f"{path}: holds {', '.join(sorted(foreign))}, which this program never records",
                remedy="check the path: this MCAP file comes from another program",
            )
        self._channels = {
            each.id: (Topic(each.topic), _pixels(each, "width"), _pixels(each, "height"))
            for each in self.channels.values()
        }
        self._entries: dict[Topic, list[Entry]] = {topic: [] for topic in Topic}
        for entry in sorted(self.entries, key=lambda item: item.log_time):
            self._entries[self._channel(entry)[0]].append(entry)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read what is readable of a recording, and check all of it.

        Raises:
            RecordError: Missing, no permission, empty, or no recording at all. An unfinished or
                damaged one opens: see ``is_intact`` and ``describe``.
        """
        with open_file(path, what="the recording") as descriptor:
            return cls(path, descriptor)

    @property
    def is_intact(self) -> bool:
        """True when the file was closed and every message in it is readable."""
        return self.finished and not self.damage

    @property
    def start_ns(self) -> int:
        """Arrival of the first message [ns]; 0 when there is none."""
        return min((each[0].log_time for each in self._entries.values() if each), default=0)

    @property
    def end_ns(self) -> int:
        """Arrival of the last message [ns]; 0 when there is none."""
        return max((each[-1].log_time for each in self._entries.values() if each), default=0)

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message [s]."""
        return (self.end_ns - self.start_ns) * 1e-9

    def describe(self) -> str:
        """Return one line: what state the file is in and how much of it is readable."""
        state = "finished" if self.finished else "unfinished (its writer was killed or is at work)"
        if self.torn_bytes:
            state += f", its last {self.torn_bytes} bytes are torn"
        if self.damage:
            state += f", damaged: {self.damage}"
        return f"{state}; {self.readable()}"

    def readable(self) -> str:
        """Return how many messages can be read and what time they span."""
        parts = ", ".join(f"{topic[1:]} {len(self._entries[topic])}" for topic in Topic)
        return f"{self.message_count} messages over {self.duration_s:.2f} s are readable ({parts})"

    @cached_property
    def force(self) -> ForceArrays:
        """The force stream, raw."""
        messages = self._decoded(Topic.FORCE)
        return ForceArrays(
            stamp_ns=_column(messages, "stamp_ns"),
            counter=_column(messages, "counter"),
            wrench=_table(messages, WRENCH_FIELDS),
        )

    @cached_property
    def arm(self) -> ArmArrays:
        """The arm's states."""
        messages = self._decoded(Topic.ARM)
        force = _table(messages, TCP_FORCE_FIELDS)
        absent = [[not each.HasField(name) for name in TCP_FORCE_FIELDS] for each in messages]
        force[np.array(absent, dtype=bool).reshape(force.shape)] = np.nan
        return ArmArrays(
            stamp_ns=_column(messages, "stamp_ns"),
            controller_time_s=_table(messages, ("controller_time_s",))[:, 0],
            pose=_table(messages, POSE_FIELDS),
            velocity=_table(messages, VELOCITY_FIELDS),
            tcp_force=force,
            **{name: _column(messages, name) for name in ARM_STATES},
        )

    def frame_stamps(self) -> tuple[Int64Array, Int64Array]:
        """Return arrival stamps [ns] and counters of all frames, each of shape [n]."""
        entries = self._entries[Topic.IMAGE]
        stamps = np.array([entry.log_time for entry in entries], dtype=np.int64)
        counters = np.array([entry.sequence for entry in entries], dtype=np.int64)
        return stamps, counters

    def frames(
        self, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[ImageFrame]:
        """Yield the frames that arrived from ``start_ns`` to ``end_ns`` [ns], both included.

        Width and height are 0 in a file whose own list of channels is damaged.
        """
        first_ns, last_ns = start_ns or 0, math.inf if end_ns is None else end_ns
        entries = self._entries[Topic.IMAGE]
        for frame in self._read(e for e in entries if first_ns <= e.log_time <= last_ns):
            has_stamp = frame.publish_time != frame.log_time
            yield ImageFrame(
                stamp_ns=frame.log_time,
                counter=frame.sequence,
                device_stamp_s=frame.publish_time / 1e9 if has_stamp else None,
                width=frame.width,
                height=frame.height,
                jpeg=decode_jpeg(frame.data, source=self.path),
            )

    def events(self) -> list[JournalEvent]:
        """Return the journal events that were recorded beside the streams."""
        events = self._read(self._entries[Topic.EVENT])
        return [decode_event(each.data, source=self.path) for each in events]

    def raw_messages(self) -> Iterator[RawMessage]:
        """Yield all messages as they were encoded, in order of arrival."""
        entries = (entry for stream in self._entries.values() for entry in stream)
        return self._read(sorted(entries, key=lambda entry: (entry.log_time, entry.offset)))

    def _decoded(self, topic: Topic) -> list[Any]:
        found = self._read(self._entries[topic])
        return [decode(topic, each.data, source=self.path) for each in found]

    def _read(self, entries: Iterable[Entry]) -> Iterator[RawMessage]:
        with open_file(self.path, what="the recording") as descriptor:
            for entry in entries:
                topic, width, height = self._channel(entry)
                yield RawMessage(
                    topic=topic,
                    log_time=entry.log_time,
                    publish_time=entry.publish_time,
                    sequence=entry.sequence,
                    data=os.pread(descriptor, entry.length, entry.offset),
                    width=width,
                    height=height,
                )

    def _channel(self, entry: Entry) -> tuple[Topic, int, int]:
        """Return the topic of a message, and of an image its width and height [px]."""
        usual = _USUAL_CHANNELS.get(entry.channel, Topic.IMAGE), 0, 0
        return self._channels.get(entry.channel, usual)


def _pixels(channel: Channel, side: str) -> int:
    text = channel.metadata.get(side, "")
    return int(text) if text.isdecimal() and len(text) < len("1000000") else 0


def _column(messages: list[Any], name: str) -> Int64Array:
    return np.array([getattr(message, name) for message in messages]).astype(np.int64)


def _table(messages: list[Any], names: tuple[str, ...]) -> FloatArray:
    rows = [[getattr(message, name) for name in names] for message in messages]
    return np.array(rows, dtype=np.float64).reshape(len(messages), len(names))
