"""The queue between a reader thread and the protocol."""

import math
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.stream_buffer_and_repeats import StreamBuffer
from tacauchy_rig.core.errors import DeviceError

LOST = DeviceError("the device is gone")


def filled(values: list[int], *, capacity: int = 100) -> StreamBuffer[int]:
    """Return a buffer with ``values`` pushed, one each 10 ms, equal values being repeats."""
    buffer = StreamBuffer[int](capacity=capacity)
    for index, value in enumerate(values):
        buffer.push(value, stamp_ns=index * 10_000_000, fingerprint=value)
    return buffer


@settings(deadline=None)
@given(st.lists(st.integers(0, 3), max_size=40), st.integers(1, 20))
def test_newest_are_kept_and_the_others_counted(values: list[int], capacity: int) -> None:
    """What is returned and what is counted as lost add up to what came."""
    buffer = filled(values, capacity=capacity)
    lost = buffer.health(lost_count=0, corrupt_count=0).lost_count
    kept = buffer.drain()
    assert kept == values[-capacity:]
    assert len(kept) + lost == len(values)


def test_health_before_anything_came() -> None:
    """An empty stream is infinitely old and has no rate."""
    health = StreamBuffer[int](capacity=3).health(lost_count=0, corrupt_count=0)
    assert health.age_s == math.inf
    assert (health.received_count, health.rate_hz, health.repeat_count) == (0, 0.0, 0)


def test_rate_and_repeats() -> None:
    """The rate comes from the stamps, the repeat count from the run that ends now."""
    health = filled([1, 1, 1, 2, 7, 7]).health(lost_count=2, corrupt_count=1)
    assert health.rate_hz == pytest.approx(100.0)
    assert (health.repeat_count, health.lost_count, health.corrupt_count) == (2, 2, 1)


def test_failure_is_raised_after_the_samples() -> None:
    """No sample is lost to an error that came after it; then the error stays."""
    buffer = filled([1, 2])
    buffer.fail(LOST)
    buffer.fail(DeviceError("a later reason"))
    assert buffer.drain() == [1, 2]
    for _ in range(2):
        with pytest.raises(DeviceError, match="the device is gone"):
            buffer.drain()


def test_waiting_ends_with_the_first_sample_the_failure_or_the_deadline() -> None:
    """Each of the three ends a wait."""
    buffer = StreamBuffer[int](capacity=3)
    assert not buffer.wait_for_first(timeout_s=0.01)
    pusher = threading.Timer(0.05, buffer.push, (1,), {"stamp_ns": 0, "fingerprint": 1})
    pusher.start()
    assert buffer.wait_for_first(timeout_s=5.0)
    pusher.join()

    broken = StreamBuffer[int](capacity=3)
    failer = threading.Timer(0.05, broken.fail, (LOST,))
    failer.start()
    with pytest.raises(DeviceError):
        broken.wait_for_first(timeout_s=5.0)
    failer.join()


def test_two_threads_lose_nothing() -> None:
    """Draining while another thread pushes returns every sample once, in order."""
    buffer = StreamBuffer[int](capacity=100_000)

    def push() -> None:
        for value in range(20_000):
            buffer.push(value, stamp_ns=time.monotonic_ns(), fingerprint=value)

    pusher = threading.Thread(target=push)
    pusher.start()
    found: list[int] = []
    while len(found) < 20_000:
        found += buffer.drain()
    pusher.join()
    assert found == list(range(20_000))
