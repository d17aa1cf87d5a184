"""Buffer of a reader thread: samples, counts and the final error; lock of a device."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from drivers.interfaces import StreamHealth
from tacauchy_rig.core.errors import DeviceError

SampleT = TypeVar("SampleT")


class StreamBuffer(Generic[SampleT]):
    """A bounded queue between one reader thread and the thread that drains it.

    Args:
        capacity: Samples kept for a late consumer; beyond it the oldest go and count as lost.
    """

    def __init__(self, *, capacity: int, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = now_ns
        self._samples: deque[SampleT] = deque()
        self._capacity = capacity
        self._changed = threading.Condition()
        self._failure: DeviceError | None = None
        self._first_ns = 0
        self._last_ns = 0
        self._received_count = 0
        self._overflow_count = 0
        self._fingerprint: Hashable = None
        self._run_length = 0

    def push(self, sample: SampleT, *, stamp_ns: int, fingerprint: Hashable) -> None:
        """Add a sample; equal fingerprints in a row count as a repeated sample."""
        with self._changed:
            if self._received_count == 0:
                self._first_ns = stamp_ns
            same = self._received_count > 0 and fingerprint == self._fingerprint
            self._run_length = self._run_length + 1 if same else 1
            self._fingerprint = fingerprint
            self._last_ns = stamp_ns
            self._received_count += 1
            self._samples.append(sample)
            if len(self._samples) > self._capacity:
                self._samples.popleft()
                self._overflow_count += 1
            self._changed.notify_all()

    def fail(self, error: DeviceError) -> None:
        """Remember why nothing more will come; the first reason stays."""
        with self._changed:
            self._failure = self._failure or error
            self._changed.notify_all()

    def wait_for_first(self, *, timeout_s: float) -> bool:
        """Wait for the first sample.

        Returns:
            Whether one has arrived in time.

        Raises:
            DeviceError: The device failed while it was waited for.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._received_count > 0 or self._failure is not None,
                timeout=max(timeout_s, 0.0),
            )
            if self._received_count == 0 and self._failure is not None:
                raise self._failure
            return self._received_count > 0

    def drain(self) -> list[SampleT]:
        """Return what has arrived since the last call, oldest first.

        Raises:
            DeviceError: The device is gone, and all that arrived before has been returned.
        """
        with self._changed:
            samples = list(self._samples)
            self._samples.clear()
            if not samples and self._failure is not None:
                raise self._failure
            return samples

    def health(self, *, lost_count: int, corrupt_count: int) -> StreamHealth:
        """Return the state of the stream; counts of the wire come from its reader."""
        with self._changed:
            received, span_ns = self._received_count, self._last_ns - self._first_ns
            age_s = (self._now_ns() - self._last_ns) * 1e-9 if received else math.inf
            return StreamHealth(
                received_count=received,
                lost_count=lost_count + self._overflow_count,
                corrupt_count=corrupt_count,
                repeat_count=self._run_length,
                age_s=age_s,
                rate_hz=(received - 1) / (span_ns * 1e-9) if span_ns > 0 else 0.0,
            )
