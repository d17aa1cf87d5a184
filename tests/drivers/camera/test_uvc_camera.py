"""The camera's driver: real cv2.VideoCapture against an MJPEG stream on loopback."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import cv2
import numpy as np
import pytest

from drivers.camera.uvc_camera import UvcCamera
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError
from tests.drivers.conftest import changed, collect, wait_until

WIDTH, HEIGHT, RATE_HZ = 320, 240, 50.0
Frames = Callable[[threading.Event], Iterator[bytes]]
ServeMjpeg = Callable[[Frames], AbstractContextManager[str]]
Connected = Callable[[Frames], AbstractContextManager[UvcCamera]]


def jpeg(number: int, *, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    """Return a JPEG whose grey level tells ``number``."""
    image = np.full((height, width, 3), 40 + number % 200, dtype=np.uint8)
    cv2.putText(image, str(number), (10, 60), cv2.FONT_HERSHEY_SIMPLEX, 1.5, (0, 0, 0))
    return bytes(cv2.imencode(".jpg", image)[1].tobytes())


def steady(ended: threading.Event) -> Iterator[bytes]:
    """Yield numbered frames on absolute deadlines."""
    due = time.monotonic()
    for number in itertools.count():
        yield jpeg(number)
        due += 1.0 / RATE_HZ
        if ended.wait(max(0.0, due - time.monotonic())):
            return


def make_camera(url: str, *, timeout_s: float = 5.0) -> UvcCamera:
    """Return a camera in the tests' mode."""
    section = {"driver": "uvc", "device": url, "connect_timeout": timeout_s}
    section |= {"width": WIDTH, "height": HEIGHT, "rate": RATE_HZ}
    return UvcCamera(changed(load_config().config, camera=section))


@pytest.fixture
def connected(serve_mjpeg: ServeMjpeg) -> Connected:
    """Return what connects a camera to a stream of given frames."""

    @contextmanager
    def connect(frames: Frames) -> Iterator[UvcCamera]:
        with serve_mjpeg(frames) as url:
            camera = make_camera(url)
            try:
                camera.connect()
                yield camera
            finally:
                camera.close()

    return connect


def test_delivers_the_bytes_that_were_sent(serve_mjpeg: ServeMjpeg) -> None:
    """Frames arrive untouched, numbered and stamped in order; the identity names the stream."""
    with serve_mjpeg(steady) as url:
        camera = make_camera(url)
        identity = camera.connect()
        frames = collect(camera, lambda found: len(found) >= 20)
        health = camera.health()
        camera.close()
        camera.close()
    assert (identity.address, identity.settings["backend"]) == (url, "FFMPEG")
    assert identity.simulated  # it comes from this computer itself
    numbers = [frame.counter - 1 for frame in frames]
    assert numbers == list(range(len(frames)))
    assert all(frame.jpeg == jpeg(frame.counter - 1) for frame in frames)
    assert [f.stamp_ns for f in frames] == sorted(f.stamp_ns for f in frames)
    assert {(f.width, f.height, f.device_stamp_s) for f in frames} == {(WIDTH, HEIGHT, None)}
    assert (health.corrupt_count, health.lost_count) == (0, 0)


def test_late_reader_gets_arrival_stamps_not_drain_stamps(connected: Connected) -> None:
    """Frames drained late keep the moments at which they came, so none looks fresh."""
    sent_ns: list[int] = []

    def noted(ended: threading.Event) -> Iterator[bytes]:
        for data in steady(ended):
            sent_ns.append(time.monotonic_ns())
            yield data

    with connected(noted) as camera:
        wait_until(lambda: camera.health().received_count >= 20)
        reached_ns = time.monotonic_ns()
        time.sleep(0.2)
        frames = camera.drain()
    assert len(frames) >= 20
    assert frames[0].stamp_ns < frames[19].stamp_ns <= reached_ns
    assert all(frame.stamp_ns >= sent_ns[frame.counter - 1] for frame in frames)


def test_nobody_draining_bounds_the_backlog_and_counts_it(connected: Connected) -> None:
    """The queue keeps the newest frames and counts the dropped ones as lost."""

    def burst(ended: threading.Event) -> Iterator[bytes]:
        yield from (jpeg(number % 50) for number in range(300))
        ended.wait()

    with connected(burst) as camera:
        wait_until(lambda: camera.health().received_count >= 299)
        health = camera.health()
        frames = camera.drain()
    assert len(frames) == 200  # four seconds at the nominal rate
    assert health.lost_count == health.received_count - 200
    assert frames[-1].counter == health.received_count


def test_garbled_frames_are_counted_and_withheld(connected: Connected) -> None:
    """Truncated and overwritten frames never reach the record; their numbers stay free."""

    def damaged(ended: threading.Event) -> Iterator[bytes]:
        for number, data in enumerate(steady(ended)):
            broken = {2: data[:-40], 3: b"\0\0" + data[2:]}
            yield broken.get(number % 5, data)

    with connected(damaged) as camera:
        frames = collect(camera, lambda found: len(found) >= 12)
        health = camera.health()
    assert {(frame.counter - 1) % 5 for frame in frames} == {0, 1, 4}
    assert health.corrupt_count >= 6
    assert all(frame.jpeg == jpeg(frame.counter - 1) for frame in frames)


def test_frozen_camera_is_seen_as_repeats(connected: Connected) -> None:
    """Equal frames in a row raise the repeat count."""

    def frozen(ended: threading.Event) -> Iterator[bytes]:
        yield from itertools.islice(steady(ended), 3)
        while not ended.wait(1.0 / RATE_HZ):
            yield jpeg(9)

    with connected(frozen) as camera:
        frames = collect(camera, lambda _: camera.health().repeat_count >= 10)
        health = camera.health()
    assert health.repeat_count >= 10
    # The repeats are delivered all the same, and none of them counts as lost or damaged.
    assert [frame.counter for frame in frames] == list(range(1, len(frames) + 1))
    assert (health.lost_count, health.corrupt_count) == (0, 0)


def test_stall_blocks_neither_drain_nor_close(connected: Connected) -> None:
    """While OpenCV waits for a frame, the age grows and every call returns."""

    def stalling(ended: threading.Event) -> Iterator[bytes]:
        yield from itertools.islice(steady(ended), 5)
        ended.wait()

    with connected(stalling) as camera:
        frames = collect(camera, lambda _: camera.health().age_s > 0.3)
        assert len(frames) <= 5
        assert camera.drain() == []
        camera.close()


def test_unplug_raises_after_the_last_frame(connected: Connected) -> None:
    """When the stream ends, what came is returned first and then the error."""

    def ending(ended: threading.Event) -> Iterator[bytes]:
        yield from itertools.islice(steady(ended), 10)

    with connected(ending) as camera:
        frames = collect(camera, lambda found: len(found) >= 9)
        for _ in range(2):
            with pytest.raises(DeviceError, match="is gone: its stream ended"):
                collect(camera, lambda _: False)
    assert [frame.counter for frame in frames[:9]] == list(range(1, 10))


def test_other_size_is_refused(serve_mjpeg: ServeMjpeg) -> None:
    """A stream in another mode than asked is an error that names both."""

    def larger(ended: threading.Event) -> Iterator[bytes]:
        while not ended.wait(0.02):
            yield jpeg(1, width=640, height=480)

    with (
        serve_mjpeg(larger) as url,
        pytest.raises(DeviceError, match="640x480 px instead of 320x240"),
    ):
        make_camera(url).connect()


def test_nothing_listening() -> None:
    """An address where nothing answers is told at once."""
    with pytest.raises(DeviceError, match=r"nothing answers at http://127\.0\.0\.1:1/"):
        make_camera("http://127.0.0.1:1/").connect()


def test_silent_server_fails_at_the_deadline(serve_mjpeg: ServeMjpeg) -> None:
    """A server that accepts and sends nothing does not hold up the connect."""

    def silent(ended: threading.Event) -> Iterator[bytes]:
        ended.wait()
        yield from ()

    with serve_mjpeg(silent) as url, pytest.raises(DeviceError, match=r"silent|no MJPEG"):
        make_camera(url, timeout_s=1.0).connect()


def test_page_that_is_no_stream(serve_mjpeg: ServeMjpeg) -> None:
    """A server that sends something else is named."""

    def words(_: threading.Event) -> Iterator[bytes]:
        yield b"hello"

    with serve_mjpeg(words) as url, pytest.raises(DeviceError, match="camera: ") as caught:
        make_camera(url, timeout_s=3.0).connect()
    assert caught.value.remedy
