"""One thread that makes every call into ur_rtde's control interface, each with a deadline.

The control interface is not thread-safe and polls up to 300 s for a controller that fell
silent. Its ordinary calls release the interpreter lock, so the caller can stop waiting.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from tacauchy_rig.errors import DeviceError

T = TypeVar("T")
_Job = tuple[Callable[[], object], Future[object]]


class Commander:
    """Runs calls in order on its own thread.

    A call that misses its deadline cannot be taken back: the commander then refuses all others,
    and the process that owns it should end.

    Args:
        device: Name for messages.
    """

    def __init__(self, device: str) -> None:
        self._device = device
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._stuck_in = ""
        # A daemon, because a stuck call must not hold up the end of the process.
        self._thread = threading.Thread(target=self._run, name="ur5-commander", daemon=True)
        self._thread.start()

    @property
    def is_stuck(self) -> bool:
        """True once a call missed its deadline."""
        return bool(self._stuck_in)

    def call(self, activity: str, function: Callable[[], T], *, deadline_s: float) -> T:
        """Return what ``function`` returns.

        Args:
            activity: What it does, for messages.
            function: Makes one call into the library.
            deadline_s: How long to wait [s].

        Raises:
            DeviceError: No answer in time, now or earlier, or the library raised an error.
        """
        if self._stuck_in:
            raise DeviceError(
                f"{self._device}: {activity} is not possible, {self._stuck_in} still waits",
                remedy="the connection is lost: end this program and start it again",
            )
        future: Future[object] = Future()
        self._jobs.put((function, future))
        try:
            return future.result(timeout=deadline_s)  # type: ignore[return-value]
        except TimeoutError as error:
            self._stuck_in = activity
            raise DeviceError(
                f"{self._device}: {activity} got no answer within {deadline_s:g} s",
                remedy="look at the controller and the network; the watchdog stops the arm",
            ) from error
        except (RuntimeError, ValueError) as error:
            raise DeviceError(f"{self._device}: {activity} failed: {error}") from error

    def close(self) -> None:
        """End the thread, unless a call holds it."""
        self._jobs.put(None)
        if not self._stuck_in:
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            function, future = job
            try:
                future.set_result(function())
            except BaseException as error:  # noqa: BLE001 - handed to the caller
                future.set_exception(error)
            # Otherwise the last call would keep the interface alive until the next one.
            del job, function, future
