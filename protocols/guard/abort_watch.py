"""Every way in which a person, or the loss of one, asks the run to stop.

Signals reach the abort from their handler and keys from a thread, so neither waits for anything
that the main thread may be doing.
"""

from __future__ import annotations

import logging
import os
import select
import signal
import sys
import termios
import threading
import tty
from types import FrameType, TracebackType
from typing import Any, Self

from protocols.guard.abort import Abort

logger = logging.getLogger(__name__)

SIGNALS = {
    signal.SIGINT: "Ctrl-C",
    signal.SIGTERM: "SIGTERM",
    signal.SIGHUP: "the terminal was lost",
    signal.SIGTSTP: "Ctrl-Z",
}
LOOK_MS = 100


class AbortWatch:
    """A context in which signals, any key and a lost terminal request an abort.

    Keys are watched only where ``terminal`` is one; it is put back as it was on leaving.

    Args:
        terminal: Descriptor of the terminal; standard input by default.
    """

    def __init__(self, *, terminal: int | None = None) -> None:
        self.abort = Abort()
        self._terminal = _standard_input() if terminal is None else terminal
        self._settings: list[Any] | None = None
        self._handlers: dict[int, Any] = {}
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        for number in SIGNALS:
            self._handlers[number] = signal.signal(number, self._heed)
        if self._terminal is not None and os.isatty(self._terminal):
            self._settings = termios.tcgetattr(self._terminal)
            tty.setcbreak(self._terminal, termios.TCSANOW)
            self._thread = threading.Thread(
                target=self._watch_keys, args=(self._terminal,), name="keys", daemon=True
            )
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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

    def _heed(self, number: int, _frame: FrameType | None) -> None:
        self.abort.request(SIGNALS[signal.Signals(number)])

    def _watch_keys(self, terminal: int) -> None:
        poll = select.poll()
        poll.register(terminal, select.POLLIN | select.POLLHUP)
        while not self._ended.is_set():
            for _, what in poll.poll(LOOK_MS):
                if not self._take(terminal, what):
                    return

    def _take(self, terminal: int, what: int) -> bool:
        """Read what is there; return False once the terminal is gone."""
        try:
            keys = os.read(terminal, 64) if what & select.POLLIN else b""
        except OSError:
            keys = b""
        if not keys:
            self.abort.request("the terminal was lost")
            return False
        self.abort.request("a key was pressed")
        return True


def _standard_input() -> int | None:
    """Return the descriptor of standard input, or None where it is closed or replaced."""
    try:
        return sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):
        return None
