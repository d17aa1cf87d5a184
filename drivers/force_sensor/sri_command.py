"""Text commands of the SRI M8128-family box: ``AT+NAME=value`` and their ``ACK+`` replies.

Documents and users disagree on the end of a reply (``$OK``, ``OK`` alone or nothing) and on
whether streaming is acknowledged, so the decoder takes all of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

END = b"\r\n"
_REPLY = re.compile(rb"ACK\+([A-Z0-9]+)=([^\r\n]*?)\$?(OK|ERROR|ERR)?\r\n")
_COMMAND = re.compile(r"AT\+([A-Z0-9]+)(?:=(.*))?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A command as the box reads it; ``value`` is None where no ``=`` follows the name."""

    name: str
    value: str | None = None

    @property
    def is_query(self) -> bool:
        """True for ``AT+NAME=?``."""
        return self.value == "?"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """An answer of the box; ``refused`` only where it says ERROR."""

    name: str
    value: str
    refused: bool = False


def encode_command(command: Command) -> bytes:
    """Encode a command, for example ``AT+DCKMD=SUM``."""
    text = command.name if command.value is None else f"{command.name}={command.value}"
    return b"AT+" + text.encode("ascii") + END


def decode_command(line: bytes) -> Command | None:
    """Decode one line without its end, or return None where it is no command."""
    match = _COMMAND.fullmatch(line.decode("ascii", "replace").strip())
    return None if match is None else Command(name=match.group(1), value=match.group(2))


def encode_reply(reply: Reply) -> bytes:
    """Encode a reply, for example ``ACK+SMPF=100$OK``."""
    end = "$ERROR" if reply.refused else "$OK"
    return f"ACK+{reply.name}={reply.value}{end}".encode("ascii") + END


def find_reply(data: bytes, *, name: str) -> Reply | None:
    """Return the newest complete reply to ``name`` in ``data``, which may hold frames as well."""
    found = None
    for match in _REPLY.finditer(data):
        if match.group(1) == name.encode("ascii"):
            refused = (match.group(3) or b"").startswith(b"ERR")
            value = match.group(2).decode("ascii", "replace")
            found = Reply(name=name, value=value, refused=refused)
    return found
