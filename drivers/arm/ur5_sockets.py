"""Notice that ur_rtde reconnected by itself, which it does without telling.

After any loss the library connects again and uploads its program again. This project wants a
person to look first, so the connections in use are remembered by the kernel's numbers for them.
"""

from __future__ import annotations

import os
import socket

from drivers.arm.ur5_wire import RTDE_PORT

_DESCRIPTORS = "/proc/self/fd"


class RtdeSockets:
    """This process's connections to the RTDE port of one controller (Linux only)."""

    def __init__(self) -> None:
        self._names: dict[int, str] = {}

    def remember(self, host: str) -> None:
        """Take the connections to ``host`` that are open now as the ones to watch."""
        address = socket.gethostbyname(host)
        self._names = {
            number: name
            for number, name in _open_sockets().items()
            if _peer(number) == (address, RTDE_PORT)
        }

    @property
    def count(self) -> int:
        """Number of connections found."""
        return len(self._names)

    def are_unchanged(self) -> bool:
        """Return False once any of them was closed or replaced."""
        try:
            return all(
                os.readlink(f"{_DESCRIPTORS}/{number}") == name  # noqa: PTH115 - every cycle
                for number, name in self._names.items()
            )
        except OSError:
            return False


def _open_sockets() -> dict[int, str]:
    found: dict[int, str] = {}
    for entry in os.listdir(_DESCRIPTORS):  # noqa: PTH208 - names of descriptors, not files
        try:
            name = os.readlink(f"{_DESCRIPTORS}/{entry}")  # noqa: PTH115
        except OSError:
            continue
        if name.startswith("socket:"):
            found[int(entry)] = name
    return found


def _peer(descriptor: int) -> tuple[str, int] | None:
    try:
        with socket.socket(fileno=os.dup(descriptor)) as link:
            if link.family != socket.AF_INET:
                return None
            host, port = link.getpeername()
            return host, port
    except OSError:
        return None
