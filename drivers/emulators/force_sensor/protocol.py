"""The command side of an emulated M8128-family box: settings, replies, and what to stream.

Documents disagree on the name of the rate command and on the form of a reply, so both can be
chosen; a driver must get along with each.
"""

from __future__ import annotations

from enum import StrEnum

from drivers.force_sensor.sri_command import END, Command, Reply, decode_command, encode_reply
from tacauchy_rig.config.model import Checksum

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
        *lines, rest = (self._line + data).split(END)
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
        if command.is_query:
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
