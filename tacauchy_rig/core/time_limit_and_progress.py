"""Time limit and progress of a long computation.

Callers limit the time and listen; what computes says, far down, what it does, and asks whether time
is left. Both hold for the thread that began them.
"""

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Event, Thread

from tacauchy_rig.core.errors import TimeLimitError

_SILENT_S, _TICK_SHARE = 2.0, 0.1
"""A tick later than that it speaks, and on a busy computer later still: three seconds at most."""

_end: ContextVar[tuple[float, float]] = ContextVar("_end", default=(math.inf, math.inf))
_steps: ContextVar[list[str] | None] = ContextVar("_steps", default=None)
_listener: ContextVar[Callable[[str], None]] = ContextVar("_listener", default=lambda _: None)


@contextmanager
def time_limit(limit_s: float | None) -> Iterator[None]:
    """Let what runs within take so long at most [s]; of limits within limits the nearest counts."""
    if limit_s is None:
        yield
        return
    token = _end.set(min(_end.get(), (time.monotonic() + limit_s, limit_s)))
    try:
        yield
    finally:
        _end.reset(token)


def time_left_s() -> float:
    """Return how much time is left [s]; infinite without a limit."""
    return _end.get()[0] - time.monotonic()


def check_time() -> None:
    """End where the time is over. TimeLimitError: It is; the message says what was being done."""
    end, limit_s = _end.get()
    if time.monotonic() > end:
        done = ": ".join(_steps.get() or ["computing"])
        raise TimeLimitError(
            f"not finished after the time limit of {limit_s:g} s ({done})",
            remedy="allow more time, press less deep, or take a coarser preset",
        )


@contextmanager
def doing(what: str) -> Iterator[Callable[[str], None]]:
    """Say what is done within; the function given says how far it is.

    Raises:
        TimeLimitError: No time is left to begin it.
    """
    check_time()
    known = _steps.get()
    steps: list[str] = [] if known is None else known
    token = _steps.set(steps)
    depth = len(steps)
    steps.append(what)

    def at(detail: str) -> None:
        steps[depth:] = [f"{what}: {detail}"]

    try:
        yield at
    finally:
        del steps[depth:]
        _steps.reset(token)


@contextmanager
def told(say: Callable[[str], None], *, silent_s: float = _SILENT_S) -> Iterator[None]:
    """Say every few seconds [s] what is done within, once it has been done for as long.

    Args:
        say: Called by another thread.
    """
    steps: list[str] = []
    token, over = _steps.set(steps), Event()

    def tell() -> None:
        began = said = time.monotonic()
        while not over.wait(_TICK_SHARE * silent_s):
            now = time.monotonic()
            if not steps:
                began = said = now
            elif now - said >= silent_s:
                said = now
                say(f"  {now - began:.0f} s: {': '.join(steps.copy())}")

    teller = Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        over.set()
        teller.join()
        _steps.reset(token)


@contextmanager
def heard(listener: Callable[[str], None]) -> Iterator[None]:
    """Have one listener told every line of progress that is said within."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def say(line: str) -> None:
    """Tell whoever listens a line of progress."""
    _listener.get()(line)


class Remaining:
    """How long a work may still take, by what its parts are expected to cost.

    Args:
        total_s: Processor time that all of it is expected to need [s].
        jobs: Processes that share it.
    """

    # Until so much [s] is done, what other programs leave of the processors counts, too.
    _TRUSTED_S = 15.0

    def __init__(self, total_s: float, *, jobs: int = 1) -> None:
        self._left_s, self._done_s = total_s, 0.0
        self.begin()
        busy = (os.getloadavg()[0] + jobs) / (os.cpu_count() or 1)
        self._pace = max(1.0, busy) / jobs

    def begin(self) -> None:
        """Count the time that it takes from now on."""
        self._began = time.monotonic()

    def add(self, cost_s: float) -> None:
        """Note that more is left to do."""
        self._left_s += cost_s

    def spend(self, cost_s: float) -> None:
        """Note that a part of it is done."""
        self._left_s, self._done_s = self._left_s - cost_s, self._done_s + cost_s

    def seconds(self) -> float:
        """Return the time left [s]."""
        took_s = time.monotonic() - self._began if self._done_s else 0.0
        pace = (self._TRUSTED_S * self._pace + took_s) / (self._TRUSTED_S + self._done_s)
        return max(0.0, self._left_s) * pace

    def __str__(self) -> str:
        left_s = self.seconds()
        if left_s < 90.0:
            return f"about {left_s:.0f} s left"
        return f"about {left_s / 60.0:.0f} min left"
