"""The command side of an emulated M8128-family box: settings, replies, and what to stream.

Documents disagree on the name of the rate command and on the form of a reply, so both can be
chosen; a driver must get along with each.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable
from enum import StrEnum

from drivers.device.faults import Fault, FaultKind
from drivers.device.lies import LyingWrench
from drivers.force_sensor.sri_wire import (
    LINE_END,
    Command,
    Reply,
    decode_command,
    encode_frame,
    encode_reply,
)
from tacauchy_rig.core.config.model import Checksum
from tacauchy_rig.core.run import Vector6

MAX_RATE_HZ = 2000
_LINE_LIMIT = 1024
_CONSTANTS = {
    "DCPM": ";".join(
        "(" + ",".join("1.0" if i == j else "0.0" for j in range(6)) + ")" for i in range(6)
    ),
    "AMPZ": "32768;32768;32768;32768;32768;32768",
    "CHNAPG": "100.0;100.0;100.0;100.0;100.0;100.0",
    "EXMV": "5.0;5.0;5.0;5.0;5.0;5.0",
}


class ReplyStyle(StrEnum):
    """How the emulated box ends its replies."""

    DOLLAR_OK = "dollar-ok"
    BARE_OK = "bare-ok"
    SILENT = "silent"


class BoxCommands:
    """Settings of the box and the commands that change them.

    Attributes:
        streaming: Whether frames go out by themselves; a box keeps on when its port is closed.
        single_count: Frames asked for one by one and not yet sent.
        zero_requested: ``ADJZF`` came and has not been applied yet.
    """

    def __init__(
        self,
        *,
        rate_hz: int = 100,
        rate_command: str = "SMPF",
        style: ReplyStyle = ReplyStyle.DOLLAR_OK,
    ) -> None:
        self.rate_hz = rate_hz
        self.checksum = Checksum.SUM
        self.streaming = False
        self.single_count = 0
        self.zero_requested = False
        self._format = ""
        self._rate_command = rate_command
        self._style = style
        self._line = b""

    def receive(self, data: bytes) -> bytes:
        """Take bytes from the host and return the replies to the lines that they complete."""
        *lines, rest = (self._line + data).split(LINE_END)
        self._line = rest[-_LINE_LIMIT:]
        return b"".join(self._answer(line) for line in lines)

    def _answer(self, line: bytes) -> bytes:
        command = decode_command(line)
        if command is None:
            return b""
        reply = self._execute(command)
        if self._style is ReplyStyle.SILENT or reply is None:
            return b""
        data = encode_reply(reply)
        return data.replace(b"$", b"") if self._style is ReplyStyle.BARE_OK else data

    def _execute(self, command: Command) -> Reply | None:
        name, value = command.name, command.value or ""
        if value == "?":
            return self._query(name)
        if name == "GOD":
            self.single_count += 1
            return None
        if name == "GSD":
            self.streaming = value != "STOP"
            return Reply(name=name, value=value)
        if name == self._rate_command and value.isdecimal() and 0 < int(value) <= MAX_RATE_HZ:
            self.rate_hz = int(value)
        elif name == "DCKMD" and value in set(Checksum):
            self.checksum = Checksum(value)
        elif name == "SGDM" and value.startswith("(A01,A02,A03,A04,A05,A06);E;1;"):
            self._format = value
        elif name == "ADJZF":
            self.zero_requested = True
        else:
            return Reply(name=name, value=value, refused=True)
        return Reply(name=name, value=value)

    def _query(self, name: str) -> Reply:
        known = {
            self._rate_command: str(self.rate_hz),
            "DCKMD": self.checksum.value,
            "SGDM": self._format,
            **_CONSTANTS,
        }
        if name not in known:
            return Reply(name=name, value="", refused=True)
        return Reply(name=name, value=known[name])


class FrameStream:
    """Turn values into the bytes that leave the box, as faults allow.

    Args:
        full_scale_n: What Fz reads when its channel is saturated [N].
        latency_s: From the moment that a frame belongs to until it leaves [s].

    Attributes:
        number: Package number of the newest frame, not wrapped; it advances in every fault.
    """

    def __init__(self, *, seed: int, full_scale_n: float, latency_s: float = 0.0) -> None:
        self._random = random.Random(seed)  # noqa: S311 - faults, not secrets
        self._wrench = LyingWrench(seed=seed, full_scale_n=full_scale_n)
        self._latency_s = latency_s
        self._waiting: deque[tuple[int, bytes]] = deque()
        self.number = -1

    def next_frame(
        self, values: Vector6, *, stamp_ns: int, faults: Iterable[Fault], checksum: Checksum
    ) -> None:
        """Queue the next frame."""
        self.number += 1
        active = {fault.kind: fault for fault in faults}
        values = self._wrench.reading(values, active.values(), stamp_ns=stamp_ns)
        if FaultKind.STALL in active or self._strikes(active.get(FaultKind.DROP)):
            return
        data = encode_frame(self.number, values, checksum=checksum)
        if self._strikes(active.get(FaultKind.GARBLE)):
            data = self._garble(data)
        delay_s = self._latency_s
        if FaultKind.DELAY in active:
            delay_s += active[FaultKind.DELAY].size
        self._waiting.append((stamp_ns + int(delay_s * 1e9), data))

    @property
    def next_due_ns(self) -> int | None:
        """When the next waiting frame leaves; None where none waits."""
        return self._waiting[0][0] if self._waiting else None

    def due(self, now_ns: int) -> bytes:
        """Return the bytes that leave the box by ``now_ns``, in order."""
        data = b""
        while self._waiting and self._waiting[0][0] <= now_ns:
            data += self._waiting.popleft()[1]
        return data

    def _strikes(self, fault: Fault | None) -> bool:
        return fault is not None and self._random.random() < fault.size

    def _garble(self, data: bytes) -> bytes:
        damaged = bytearray(data)
        for _ in range(3):
            damaged[self._random.randrange(len(damaged))] ^= self._random.randrange(1, 256)
        return bytes(damaged)
