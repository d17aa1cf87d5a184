"""What every device answers: who it is, and, where it streams, what arrived and how well.

No call of a device blocks longer than its stated deadline. Reads return what has already arrived;
whether that is too old is judged by age, never by waiting.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol, TypeVar


class Clock(Protocol):
    """What stamps everything that arrives."""

    def now_ns(self) -> int:
        """Return nanoseconds since an arbitrary start."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s]."""
        ...


class HostClock:
    """``time.monotonic_ns``; the same clock in every process of this host."""

    def now_ns(self) -> int:
        """Return nanoseconds of the host's monotonic clock."""
        return time.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s]; nothing at or below zero."""
        if duration_s > 0.0:
            time.sleep(duration_s)


SampleT = TypeVar("SampleT")


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceIdentity:
    """Who answered: goes into every record.

    Attributes:
        simulated: True for emulators and mocks, so that a report can say so.
    """

    driver: str
    address: str
    model: str
    serial: str
    simulated: bool
    settings: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHealth:
    """How well a stream has been arriving since it was started.

    Attributes:
        age_s: Since the newest sample arrived; infinite before the first.
        lost_count: Samples that the device counted and this host never saw.
        corrupt_count: Bytes or frames dropped because length or checksum disagreed.
        repeat_count: Longest run of identical consecutive samples, now.
        clipped_ratio: Share of the newest judged image that is at full scale; 0 for other streams.
    """

    received_count: int = 0
    lost_count: int = 0
    corrupt_count: int = 0
    repeat_count: int = 0
    age_s: float = math.inf
    rate_hz: float = 0.0
    clipped_ratio: float = 0.0


class StreamingDevice(Protocol[SampleT]):
    """A device that sends samples by itself, which a reader takes in as they come."""

    def connect(self) -> DeviceIdentity:
        """Open, identify, set up and start, and see the first sample before the deadline.

        Raises:
            DeviceError: Absent, no permission, in use, silent, speaking something else, or in
                another mode than asked.
        """
        ...

    def drain(self) -> list[SampleT]:
        """Return every sample that arrived since the last call, oldest first; never blocks.

        Raises:
            DeviceError: The device is gone; raised once all that came before was returned.
        """
        ...

    def health(self) -> StreamHealth:
        """Return counts, age and rate of the stream."""
        ...

    def close(self) -> None:
        """Stop the stream and release the device. Safe to call twice."""
        ...
