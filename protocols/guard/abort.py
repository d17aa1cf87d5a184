"""A person's request to stop, from wherever it comes: signals, keys, the loss of the terminal."""

import logging
import math
import os
import select
import signal
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable
from types import FrameType
from typing import Any, Self

logger = logging.getLogger(__name__)

SIGNALS = {
    signal.SIGINT: "Ctrl-C",
    signal.SIGTERM: "SIGTERM",
    signal.SIGHUP: "the terminal was lost",
    signal.SIGTSTP: "Ctrl-Z",
}
SAME_REQUEST_S = 0.7
POLL_MS = 100


class Abort:
    """Counts requests to stop; safe to call from a signal handler or a thread.

    The first request stops the arm and takes it slowly off the gel; a second one, at least
    ``same_request_s`` later, holds it where it is. One Ctrl-C reaches several processes and comes
    here several times at once.
    """

    def __init__(self, *, same_request_s: float = SAME_REQUEST_S) -> None:
        self._same_request_s = same_request_s
        self._asked_s = -math.inf
        self._reasons: list[str] = []
        self._listeners: list[Callable[[str], object]] = []

    def request(self, reason: str) -> None:
        """Ask to stop, because of ``reason``."""
        now_s = time.monotonic()
        if now_s - self._asked_s < self._same_request_s:
            return
        self._asked_s = now_s
        self._reasons.append(reason)
        for listener in self._listeners:
            listener(reason)

    def on_request(self, listener: Callable[[str], object]) -> None:
        """Call ``listener(reason)`` at each request, in the caller's thread; it must not block."""
        self._listeners.append(listener)

    def handle_signals(self) -> dict[int, Any]:
        """Make each of ``SIGNALS`` a request; return what they did before."""
        return {number: signal.signal(number, self._on_signal) for number in SIGNALS}

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        self.request(SIGNALS[signal.Signals(number)])

    @property
    def count(self) -> int:
        """How often it was asked."""
        return len(self._reasons)

    @property
    def reason(self) -> str:
        """The first reason, or an empty text."""
        return self._reasons[0] if self._reasons else ""


class AbortWatch:
    """A context in which signals, any key and a lost terminal request an abort.

    Keys are watched only where the descriptor (standard input by default) is a terminal; it is put
    back as it was on leaving.
    """

    def __init__(self, *, terminal: int | None = None) -> None:
        self.abort = Abort()
        self._terminal = _standard_input() if terminal is None else terminal
        self._settings: list[Any] | None = None
        self._handlers: dict[int, Any] = {}
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._handlers = self.abort.handle_signals()
        if self._terminal is not None and os.isatty(self._terminal):
            self._settings = termios.tcgetattr(self._terminal)
            tty.setcbreak(self._terminal, termios.TCSANOW)
            self._thread = threading.Thread(
                target=self._watch_keys, args=(self._terminal,), name="keys", daemon=True
            )
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        if self._settings is not None and self._terminal is not None:
            try:
                termios.tcsetattr(self._terminal, termios.TCSANOW, self._settings)
            except termios.error as problem:
                logger.warning("the terminal could not be put back: %s", problem)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _watch_keys(self, terminal: int) -> None:
        poll = select.poll()
        poll.register(terminal, select.POLLIN | select.POLLHUP)
        while not self._ended.is_set():
            for _, what in poll.poll(POLL_MS):
                try:
                    keys = os.read(terminal, 64) if what & select.POLLIN else b""
                except OSError:
                    keys = b""
                self.abort.request("a key was pressed" if keys else "the terminal was lost")
                if not keys:
                    return


def _standard_input() -> int | None:
    """Return the descriptor of standard input, or None where it is closed or replaced."""
    try:
        return sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):
        return None
