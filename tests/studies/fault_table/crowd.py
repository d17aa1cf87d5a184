"""Visitors of the operator's page who mean it no good, or have a poor line."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from enum import StrEnum
from typing import Self
from urllib.parse import urlsplit

CONNECTIONS = 200
SLOW_CLIENTS = 30
_SMALL_BUFFER_BYTES = 2048
_TIMEOUT_S = 5.0


class Crowd(StrEnum):
    """What they do."""

    FLOOD = "flood"
    SLOW_CLIENT = "slow-client"


class Visitors:
    """Connections to a page that stay open until this is closed.

    Args:
        address: Of the page, with its token.
    """

    def __init__(self, address: str) -> None:
        self._address = urlsplit(address)
        self._open = ExitStack()

    def come(self, crowd: Crowd) -> Self:
        """Open every connection: half of a flood asks for events, slow clients read nothing."""
        if crowd is Crowd.FLOOD:
            for number in range(CONNECTIONS):
                self._visit("events" if number % 2 else "", buffer_bytes=None)
        else:
            for number in range(SLOW_CLIENTS):
                path = "events" if number % 2 else "picture/camera"
                self._visit(path, buffer_bytes=_SMALL_BUFFER_BYTES)
        return self

    def close(self) -> None:
        """Close them."""
        self._open.close()

    def _visit(self, path: str, *, buffer_bytes: int | None) -> None:
        visit = self._open.enter_context(socket.socket())
        if buffer_bytes is not None:
            visit.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        visit.settimeout(_TIMEOUT_S)
        visit.connect((self._address.hostname, self._address.port))
        if path:
            first = f"GET {self._address.path}{path} HTTP/1.1"
            visit.sendall(f"{first}\r\nHost: {self._address.netloc}\r\n\r\n".encode())
