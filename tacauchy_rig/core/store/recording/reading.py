"""Reading a recording back, finished or not, whole or damaged."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from mcap.records import Channel

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.run import ImageFrame, JournalEvent
from tacauchy_rig.core.store.layout import run_root_of
from tacauchy_rig.core.store.recording.messages import (
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
from tacauchy_rig.core.store.recording.scan import Entry, Scan, scan_file
from tacauchy_rig.core.store.run_files import open_file

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


class Recording:
    """One attempt's streams. What it returns passed its checksums when it was opened.

    Attributes:
        path: The MCAP file.
        finished: It was closed by its writer, so public viewers can open it.
        damage: What is wrong with it beside being unfinished, in words; empty if nothing is.
        torn_bytes: Bytes at the end of an unfinished file that are no whole message.
        metadata: What the writer was told about the attempt.
        message_count: Readable messages.
    """

    def __init__(self, path: Path, scan: Scan) -> None:
        self.path = path
        self.finished = scan.finished
        self.damage = "; ".join(scan.problems)
        self.torn_bytes = scan.torn_bytes
        self.metadata = dict(scan.metadata)
        self.message_count = len(scan.entries)
        self._channels = {
            each.id: (Topic(each.topic), _pixels(each, "width"), _pixels(each, "height"))
            for each in scan.channels.values()
        }
        self._entries: dict[Topic, list[Entry]] = {topic: [] for topic in Topic}
        for entry in sorted(scan.entries, key=lambda item: item.log_time):
            self._entries[self._channel(entry)[0]].append(entry)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read what is readable of a recording, and check all of it.

        Raises:
            RecordError: Missing, no permission, empty, or no recording at all. An unfinished or
                damaged one opens: see ``is_intact`` and ``describe``.
        """
        with open_file(path, what="the recording") as descriptor:
            scan = scan_file(descriptor)
        if scan.size == 0:
            raise RecordError(
                f"{path}: the recording is empty (0 bytes): its writer ended before its first "
                "write, so nothing can be recovered",
                remedy=f"`{command_line('resume', run_root_of(path))}` presses this trial again",
            )
        if not scan.has_magic and not scan.entries:
            raise RecordError(
                f"{path}: not an MCAP recording: {scan.size} bytes, and no whole message in them",
                remedy="check the path; the file was replaced, or its disk is failing",
            )
        foreign = {channel.topic for channel in scan.channels.values()} - set(Topic)
        if foreign:
            raise RecordError(
                f"{path}: holds {', '.join(sorted(foreign))}, which this program never records",
                remedy="check the path: this MCAP file comes from another program",
            )
        return cls(path, scan)

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

    def force(self) -> ForceArrays:
        """Return the force stream; it is decoded once."""
        return self._force

    def arm(self) -> ArmArrays:
        """Return the arm's states; they are decoded once."""
        return self._arm

    @cached_property
    def _force(self) -> ForceArrays:
        messages = self._decoded(Topic.FORCE)
        return ForceArrays(
            stamp_ns=_column(messages, "stamp_ns"),
            counter=_column(messages, "counter"),
            wrench=_table(messages, WRENCH_FIELDS),
        )

    @cached_property
    def _arm(self) -> ArmArrays:
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
                jpeg=decode_jpeg(frame.data),
            )

    def events(self) -> list[JournalEvent]:
        """Return the journal events that were recorded beside the streams."""
        return [decode_event(each.data) for each in self._read(self._entries[Topic.EVENT])]

    def raw_messages(self) -> Iterator[RawMessage]:
        """Yield all messages as they were encoded, in order of arrival."""
        entries = (entry for stream in self._entries.values() for entry in stream)
        return self._read(sorted(entries, key=lambda entry: (entry.log_time, entry.offset)))

    def _decoded(self, topic: Topic) -> list[Any]:
        return [decode(topic, each.data) for each in self._read(self._entries[topic])]

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
