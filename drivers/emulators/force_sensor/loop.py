"""The loop of an emulated M8128-family box.

It streams on absolute deadlines, keeps counting while nobody listens, serves every client that
opens the port anew, and traces the truth behind each frame.
"""

from __future__ import annotations

import json
import logging
import os
import select
import time
from typing import TextIO

from drivers.emulators.faults import Fault, FaultInbox, FaultKind, FaultSchedule
from drivers.emulators.force_sensor.port import PseudoPort
from drivers.emulators.force_sensor.protocol import BoxCommands
from drivers.emulators.force_sensor.source import WrenchSource
from drivers.emulators.force_sensor.stream import FrameStream
from tacauchy_rig.run import Vector6

_logger = logging.getLogger(__name__)

_BACKLOG_LIMIT_NS = 500_000_000
_FLUSH_FRAMES = 100


class EmulatedBox:
    """The box's loop: commands in, frames out at the moments they are due."""

    def __init__(
        self,
        port: PseudoPort,
        inbox: FaultInbox,
        *,
        commands: BoxCommands,
        stream: FrameStream,
        source: WrenchSource,
        trace: TextIO,
        parent_pid: int | None = None,
    ) -> None:
        self._port = port
        self._inbox = inbox
        self._commands = commands
        self._stream = stream
        self._source = source
        self._trace = trace
        self._parent_pid = parent_pid
        self._schedule = FaultSchedule()
        self._zero: Vector6 = (0.0,) * 6
        self._due_ns = time.monotonic_ns()
        self._rate_hz = commands.rate_hz
        self.stopping = False

    def run(self) -> None:
        """Serve until stopped, unplugged, or left behind by the parent process."""
        self._due_ns = time.monotonic_ns() + self._period_ns
        while not self.stopping and self._parent_pid in (None, os.getppid()):
            self._wait()
            now_ns = time.monotonic_ns()
            for fault in self._inbox.poll():
                self.add_fault(fault, now_ns=now_ns)
            self._answer(self._port.read(), now_ns)
            if self._has(FaultKind.UNPLUG, now_ns):
                _logger.info("unplugged")
                return
            self._send_due(now_ns)

    def add_fault(self, fault: Fault, *, now_ns: int) -> None:
        """Take in a fault, its start counted from ``now_ns``."""
        _logger.info("fault: %s", fault)
        self._schedule.add(fault, now_s=now_ns * 1e-9)

    def _has(self, kind: FaultKind, now_ns: int) -> bool:
        return any(fault.kind is kind for fault in self._schedule.active(now_ns * 1e-9))

    def _answer(self, data: bytes, now_ns: int) -> None:
        if not data or self._has(FaultKind.STALL, now_ns):
            return
        self._port.write(self._commands.receive(data))
        if self._commands.rate_hz != self._rate_hz:
            self._rate_hz = self._commands.rate_hz
            self._due_ns = now_ns + self._period_ns

    @property
    def _period_ns(self) -> int:
        return round(1e9 / self._rate_hz)

    def _wait(self) -> None:
        wake_ns = min(self._due_ns, self._stream.next_due_ns or self._due_ns)
        timeout_s = max(wake_ns - time.monotonic_ns(), 0) * 1e-9
        # A port that nobody has open would always be readable: wait for the clock alone then.
        watched: list[PseudoPort | FaultInbox] = [self._inbox]
        if self._port.is_open:
            watched.append(self._port)
        select.select(watched, [], [], timeout_s)

    def _send_due(self, now_ns: int) -> None:
        if now_ns - self._due_ns > _BACKLOG_LIMIT_NS:
            missed = (now_ns - self._due_ns) // self._period_ns
            self._stream.number += missed
            self._due_ns += missed * self._period_ns
        while self._due_ns <= now_ns:
            self._make_frame(self._due_ns)
            self._due_ns += self._period_ns
        self._port.write(self._stream.due(now_ns))

    def _make_frame(self, stamp_ns: int) -> None:
        if not self._commands.streaming and not self._commands.single_count:
            return
        self._commands.single_count = max(self._commands.single_count - 1, 0)
        force = self._source.read(stamp_ns)
        if self._commands.zero_requested:
            self._zero, self._commands.zero_requested = force.reading, False
        v = [value - zero for value, zero in zip(force.reading, self._zero, strict=True)]
        self._stream.next_frame(
            (v[0], v[1], v[2], v[3], v[4], v[5]),
            stamp_ns=stamp_ns,
            faults=self._schedule.active(stamp_ns * 1e-9),
            checksum=self._commands.checksum,
        )
        record = {
            "number": self._stream.number,
            "stamp_ns": stamp_ns,
            "force_true_n": round(force.force_true_n, 6),
            "depth_true_m": None if force.depth_true_m is None else round(force.depth_true_m, 9),
        }
        self._trace.write(json.dumps(record) + "\n")
        if self._stream.number % _FLUSH_FRAMES == 0:
            self._trace.flush()
