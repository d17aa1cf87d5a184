"""Time limit and progress of a long computation.

Callers limit the time and listen; what computes says, far down, what it does, and asks whether time
is left. Both hold for the thread that began them.
"""

import math
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from hashlib import sha256
from threading import Event, Thread

from tacauchy_rig.core.errors import TimeLimitError

_SILENT_S, _TICK_SHARE, _LOADING = 2.0, 0.1, "loading the program"
"""A tick later than that it speaks, and on a busy computer later still: three seconds at most."""

# How long processors are looked at [s], and what keeps them busy: threads hash it side by side.
_LOOK_S, _HASHED = 0.1, bytes(1 << 16)

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
    """Say every few seconds [s] what is done within, or that modules are loaded, if it takes long.

    Args:
        say: Called by another thread.
    """
    steps: list[str] = []
    token, over = _steps.set(steps), Event()

    def tell() -> None:
        began = said = grown = time.monotonic()
        known: float = len(sys.modules)
        while not over.wait(_TICK_SHARE * silent_s):
            now = time.monotonic()
            if steps or now > grown + silent_s:
                known = math.inf  # loaded: what is imported later is no step of its own
            elif len(sys.modules) > known:
                known, grown = len(sys.modules), now
            doing_now = steps.copy() or [_LOADING] * (known < math.inf)
            if not doing_now:
                began = said = now
            elif now - said >= silent_s:
                said = now
                say(f"  {now - began:.0f} s: {': '.join(doing_now)}")

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


def _processors(count: int) -> float:
    """Return how many processors so many threads get now, as they do beside all that runs."""
    began, used = time.monotonic(), time.process_time()

    def work(_: int) -> None:
        while time.monotonic() < began + _LOOK_S:
            sha256(_HASHED)

    with ThreadPoolExecutor(count) as pool:
        list(pool.map(work, range(count)))
    return (time.process_time() - used) / (time.monotonic() - began)


class Remaining:
    """How long a work may still take, by what its parts are expected to cost.

    Args:
        total_s: Processor time that all of it is expected to need [s].
        jobs: Processes that share it.
    """

    _TRUSTED_S = 3.0  # of expected time, which what was known before counts as

    def __init__(self, total_s: float, *, jobs: int = 1) -> None:
        self._processors = {count: max(_processors(count), 0.01) for count in {1, jobs}}
        self._jobs, self._left_s, self._slowness = jobs, 0.0, 1.0
        self._known = time.monotonic()
        self.add(total_s)

    def add(self, cost_s: float, *, alone: bool = False) -> None:
        """Note that there is more to do, by all processes or by one alone."""
        self._left_s += cost_s / self._processors[1 if alone else self._jobs]

    def spend(self, cost_s: float, *, alone: bool = False) -> None:
        """Note that a part of it is done."""
        before_s, began = self._left_s, self._known
        self.add(-cost_s, alone=alone)
        self._known = time.monotonic()
        took_s = self._TRUSTED_S * self._slowness + self._known - began
        self._slowness = took_s / (self._TRUSTED_S + before_s - self._left_s)

    def seconds(self) -> float:
        """Return the time left [s]."""
        return max(0.0, self._left_s) * self._slowness

    def __str__(self) -> str:
        left_s = self.seconds()
        if left_s < 180.0:
            return f"about {left_s:.0f} s left"
        return f"about {left_s / 60.0:.0f} min left"
