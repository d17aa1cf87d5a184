"""A person's wish to stop, from wherever it comes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

SAME_WISH_S = 0.7


class Abort:
    """Counts requests to stop; safe to call from a signal handler or a thread.

    The first request stops the arm and takes it slowly off the gel; a second one, at least
    ``same_wish_s`` later, holds it where it is. One Ctrl-C reaches several processes and comes
    here several times at once.
    """

    def __init__(self, *, same_wish_s: float = SAME_WISH_S) -> None:
        self._same_wish_s = same_wish_s
        self._asked_s = -math.inf
        self._reasons: list[str] = []
        self._listeners: list[Callable[[str], None]] = []

    def request(self, reason: str) -> None:
        """Ask to stop, because of ``reason``."""
        now_s = time.monotonic()
        if now_s - self._asked_s < self._same_wish_s:
            return
        self._asked_s = now_s
        self._reasons.append(reason)
        for listener in self._listeners:
            listener(reason)

    def on_request(self, listener: Callable[[str], None]) -> None:
        """Call ``listener(reason)`` at each request, in the caller's thread; it must not block."""
        self._listeners.append(listener)

    @property
    def count(self) -> int:
        """How often it was asked."""
        return len(self._reasons)

    @property
    def reason(self) -> str:
        """The first reason, or an empty text."""
        return self._reasons[0] if self._reasons else ""
