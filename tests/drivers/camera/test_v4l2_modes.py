"""The camera's driver and the real OpenCV against a V4L2 device that a preloaded library plays."""

import base64
import itertools
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.camera.uncompressed_frames import RollWatch
from drivers.camera.v4l2_modes import REQUESTS, Offer, PixelFormat, VideoMode, modes_for
from drivers.emulators.camera.frames_and_noise import (
    description_of,
    encode_jpeg,
    encode_yuyv,
    preloaded,
    serve_device,
)
from tacauchy_rig.core.config.settings import VideoDeviceName
from tacauchy_rig.core.errors import DeviceError

MINI, DIGIT = (description_of(name) for name in VideoDeviceName)
SMALL = "card Small\nmode {} 320 240 60 30\n"
_LOST_BYTES = 3060


def pictures(width: int, height: int, *, count: int = 4) -> list[np.ndarray]:
    """Return noisy pictures of something like a gel, BGR, no two alike."""
    source = np.random.default_rng(3)
    coarse = source.integers(40, 215, (6, 8, 3), dtype=np.uint8)
    gel = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    noise = source.integers(0, 5, (count, height, width, 1), dtype=np.uint8)
    return [cv2.add(gel, np.repeat(each, 3, axis=2)) for each in noise]


def nv12(picture: np.ndarray) -> bytes:
    """Return a picture as NV12: its luminance, then U and V of each 2 x 2 pixels."""
    height, width = picture.shape[:2]
    planes = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
    chroma = planes[height:].reshape(2, height // 2, width // 2)
    return planes[:height].tobytes() + np.moveaxis(chroma, 0, -1).tobytes()


def decoded(jpeg: bytes) -> np.ndarray:
    """Return a recorded frame, BGR."""
    return np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def grey(picture: np.ndarray) -> bytes:
    """Return a picture's luminance."""
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).tobytes()


@dataclass
class Bench:
    """A device to plug in, and a process that opens it."""

    path: Path
    process: subprocess.Popen[str]

    @contextmanager
    def plugged(
        self,
        description: str,
        frames: list[bytes],
        *,
        until: int | None = None,
        rate_hz: float = 50.0,
    ) -> Iterator[None]:
        """Plug a device in that sends ``frames`` over and over.

        With ``until`` it is unplugged when it has sent so many while somebody listened.
        """
        Path(f"{self.path}.calls").unlink(missing_ok=True)
        server = serve_device(self.path, description)
        ended = threading.Event()

        def send() -> None:
            while until is not None and not self.is_streaming and not ended.wait(0.005):
                pass
            start_s = time.monotonic()
            for number in itertools.count() if until is None else range(until):
                server.publish(frames[number % len(frames)])
                if ended.wait(max(0.0, start_s + (number + 1) / rate_hz - time.monotonic())):
                    return
            server.close()

        sender = threading.Thread(target=send)
        sender.start()
        try:
            yield
        finally:
            ended.set()
            sender.join()
            server.close()

    def ask(self, **request: Any) -> dict[str, Any]:
        """Let the other process do something, and return what it answers."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return dict(json.loads(self.process.stdout.readline()))

    def take(
        self, width: int, height: int, *more: str, count: int = 4, timeout: str = "5 s"
    ) -> dict[str, Any]:
        """Connect the driver and take frames."""
        settings = (*self.settings(width, height), f'camera.connect_timeout="{timeout}"', *more)
        found = self.ask(overrides=settings, count=count)
        found["frames"] = [base64.b64decode(frame) for frame in found["frames"]]
        return found

    def settings(self, width: int, height: int) -> tuple[str, ...]:
        """Return a configuration of the device, of this size [px]."""
        device = ('camera.driver="uvc"', f"camera.device={self.path}")
        return (*device, f"camera.width={width}", f"camera.height={height}")

    @property
    def is_streaming(self) -> bool:
        """Whether a program has begun to stream."""
        path = Path(f"{self.path}.calls")
        return path.exists() and "stream on" in path.read_text()

    @property
    def calls(self) -> list[str]:
        """What the device was set to, in order."""
        return Path(f"{self.path}.calls").read_text().splitlines()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Compile the library and start the process that it is preloaded into."""
    path = tmp_path_factory.mktemp("video") / "video0"
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.drivers.camera.played_camera"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **preloaded(path)},
        cwd=Path(__file__).parents[3],
    )
    yield Bench(path, process)
    process.communicate(timeout=15)


def test_a_mini_sends_its_own_jpeg(bench: Bench) -> None:
    """The one format of a GelSight Mini, at its size: every byte is recorded as it was sent."""
    sent = [encode_jpeg(each) for each in pictures(3280, 2464, count=2)]
    locked = ("camera.exposure=156", "camera.gain=3", "camera.white_balance=5000")
    with bench.plugged(MINI, sent):
        found = bench.take(3280, 2464, *locked, count=2)
    assert len(found["frames"]) >= 2
    assert set(found["frames"]) <= set(sent)
    told = {"fourcc": "MJPG", "rate_hz": "25", "exposure": "156", "gain": "3", "backend": "V4L2"}
    told |= {"white_balance": "5000", "auto_exposure": "1", "auto_white_balance": "0"}
    assert found["settings"].items() >= told.items()
    assert found["model"] == "GelSight Mini R0B 2D8Y-69GR: Ge"
    assert found["played"]
    assert found["corrupt"] == 0


def test_a_digit_sends_yuyv(bench: Bench) -> None:
    """The one format of a DIGIT: frames are its pixels, and its lamps are lit.

    The lamps' 12 bits read back as 255 at most, which is no failure.
    """
    seen = pictures(640, 480)
    wide = [np.frombuffer(encode_yuyv(each), np.uint8).reshape(480, 640, 2) for each in seen]
    expected = [cv2.cvtColor(each, cv2.COLOR_YUV2BGR_YUYV).astype(float) for each in wide]
    settings = ("sensor.name=digit", "camera.leds=[15, 15, 15]")
    with bench.plugged(DIGIT, [each.tobytes() for each in wide]):
        found = bench.take(640, 480, *settings)
    assert found["settings"]["fourcc"] == "YUYV"
    assert found["settings"]["rate_hz"] == "30"
    assert found["settings"]["leds"] == "15 15 15"
    assert found["corrupt"] == 0
    for frame in found["frames"]:
        shown = decoded(frame)
        assert min(np.abs(shown - each).mean() for each in expected) < 1.5
    assert "control 9a090d 4095" in bench.calls
    assert not any("while it streams" in call for call in bench.calls)


def test_doctor_measures_a_mini(bench: Bench) -> None:
    """It opens, its exposure is locked, and the rate of the sensor's file is what is asked for."""
    sent = [encode_jpeg(each) for each in pictures(3280, 2464, count=2)]
    settings = (*bench.settings(3280, 2464), "camera.exposure=156")
    with bench.plugged(MINI, sent, rate_hz=18.75):
        found = bench.ask(overrides=settings, measure_s=1.0)
    assert found["camera.stream"][0] == found["camera.exposure"][0] == "ok"
    assert "for 18.75 fps asked" in found["camera.rate"][1]


@pytest.mark.parametrize(
    ("name", "encode", "error"),
    [("YUYV", encode_yuyv, 2.0), ("NV12", nv12, 3.0), ("GREY", grey, 40.0)],
)
def test_uncompressed_formats_show_what_was_sent(
    bench: Bench, name: str, encode: Callable[[np.ndarray], bytes], error: float
) -> None:
    """Each format is decoded by its own bytes; grey keeps the luminance alone."""
    seen = pictures(320, 240, count=1)[0]
    with bench.plugged(SMALL.format(name), [encode(seen)]):
        found = bench.take(320, 240, count=1)
    assert found["settings"]["fourcc"] == name
    shown = decoded(found["frames"][0])
    assert np.abs(shown.astype(float) - seen).mean() < error
    luminance = [cv2.cvtColor(each, cv2.COLOR_BGR2GRAY).astype(float) for each in (shown, seen)]
    assert np.abs(luminance[0] - luminance[1]).mean() < 2.0


def test_a_refused_format_gives_way_to_the_next(bench: Bench) -> None:
    """A camera that lists MJPG and does not take it is used in the other format it lists."""
    both = SMALL.format("MJPG") + "mode YUYV 320 240 30\nrefuses MJPG\n"
    with bench.plugged(both, [encode_yuyv(each) for each in pictures(320, 240)]):
        found = bench.take(320, 240, count=1)
    assert found["settings"]["fourcc"] == "YUYV"
    with bench.plugged(SMALL.format("MJPG") + "mode YUYV 640 480 30\nrefuses MJPG\n", [b""]):
        found = bench.take(320, 240)
    assert "Small refuses MJPG 320x240 at 60 or 30 fps, which it offers" in found["error"]


def test_what_is_offered_is_told(bench: Bench) -> None:
    """A size that the camera does not have is answered with those that it has."""
    with bench.plugged(DIGIT, [b""]):
        found = bench.take(1280, 720)
    assert "DIGIT: DIGIT offers no 1280x720 px as MJPG, YUYV, NV12, GREY" in found["error"]
    assert "YUYV 640x480 at 30 or 15 fps; YUYV 320x240 at 60 or 30 fps" in found["error"]


def test_a_digit_that_is_wedged_says_so_until_it_is_replugged(bench: Bench) -> None:
    """After a change of rate while it streams nothing comes, whoever opens it; a replug helps."""
    frames = [encode_yuyv(each) for each in pictures(640, 480)]
    with bench.plugged(DIGIT, frames):
        bench.ask(wedge=str(bench.path))
        assert "rate 15 while it streams" in bench.calls
        found = bench.take(640, 480, timeout="0.5 s")
        assert "is silent: no frame in 0.5 s" in found["error"]
        assert "unplug it and plug it in again" in found["remedy"]
    with bench.plugged(DIGIT, frames):
        assert bench.take(640, 480)["error"] == ""


def test_a_device_that_vanishes_is_unplugged(bench: Bench) -> None:
    """Frames that came are kept, then the error says what happened."""
    with bench.plugged(DIGIT, [encode_yuyv(each) for each in pictures(640, 480)], until=40):
        found = bench.take(640, 480, count=10**6)
    assert len(found["frames"]) > 1
    assert found["error"] == f"camera: {bench.path} is gone: it was unplugged"


def test_rolled_frames_are_withheld(bench: Bench) -> None:
    """A frame that has lost a packet is rolled from there on: counted, never recorded."""
    whole = [encode_yuyv(each) for each in pictures(640, 480)]
    rolled = whole[0][:200_000] + whole[0][200_000 + _LOST_BYTES :]
    with bench.plugged(DIGIT, [*whole, rolled], rate_hz=15.0):
        found = bench.take(640, 480, count=11)
    assert found["corrupt"] >= 1
    reference = decoded(found["frames"][0])
    for frame in found["frames"]:
        assert np.abs(decoded(frame).astype(float) - reference).mean() < 3.0


def test_bytes_of_another_format_are_named(bench: Bench) -> None:
    """A camera that says YUYV and sends JPEG is not recorded as noise."""
    jpeg = encode_jpeg(pictures(320, 240, count=1)[0])
    with bench.plugged(SMALL.format("YUYV"), [jpeg]):
        found = bench.take(320, 240)
    assert "sends JPEG instead of YUYV" in found["error"]


@pytest.mark.parametrize(
    ("asked", "message", "remedy"),
    [
        ("camera.exposure=9999", "exposure was set to 9999 and reads back 5000", "1 to 5000"),
        ("camera.leds=[1, 2, 3]", "has no control for camera.leds", "leave camera.leds out"),
    ],
)
def test_a_value_that_is_not_kept_is_an_error(
    bench: Bench, asked: str, message: str, remedy: str
) -> None:
    """What would change the images and is asked for either holds or ends the connection."""
    with bench.plugged(MINI, [b""]):
        found = bench.take(3280, 2464, asked)
    assert message in found["error"]
    assert remedy in found["remedy"]


def test_request_numbers_are_those_of_the_kernels_header(tmp_path: Path) -> None:
    """A compiler says them: each holds the size of its structure."""
    lines = [f'printf("%lu\\n", (unsigned long){name});' for name in REQUESTS]
    head = "#include <stdio.h>\n#include <linux/videodev2.h>\nint main(void) {"
    program = tmp_path / "numbers"
    source = f"{head} {' '.join(lines)} return 0; }}".encode()
    subprocess.run(["cc", "-x", "c", "-", "-o", str(program)], input=source, check=True)
    found = subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout
    assert [int(line) for line in found.split()] == list(REQUESTS.values())


def offer(*modes: VideoMode) -> Offer:
    """Return what a camera of these modes says."""
    return Offer(driver="uvcvideo", card="Camera", modes=modes, ranges={})


def test_the_lowest_rate_that_suffices_is_asked_for() -> None:
    """A Mini that advertises 25 and delivers 18.75 is asked for 25; 15 of a DIGIT is 15."""
    mode = VideoMode(pixel_format="YUYV", width=640, height=480, rates_hz=(30.0, 15.0))
    assert [mode.rate_for(asked) for asked in (10.0, 15.0, 18.75, 30.0, 60.0)] == [
        15,
        15,
        30,
        30,
        30,
    ]
    uneven = VideoMode(pixel_format="YUYV", width=640, height=480, rates_hz=(30000 / 1001,))
    assert uneven.rate_for(30.0) == 30000 / 1001


def test_a_format_that_is_fast_enough_comes_first() -> None:
    """JPEG is preferred, unless only the other format delivers the rate."""
    jpeg, slow, fast = (
        VideoMode(pixel_format=name, width=640, height=480, rates_hz=rates)
        for name, rates in (("MJPG", (15.0,)), ("YUYV", (5.0,)), ("YUYV", (30.0,)))
    )
    size = {"width": 640, "height": 480}
    assert modes_for(offer(slow, jpeg), **size, rate_hz=15.0)[0] is jpeg
    assert modes_for(offer(jpeg, fast), **size, rate_hz=30.0)[0] is fast
    with pytest.raises(DeviceError, match=r"offers no 640x480 px as MJPG.*H264 640x480"):
        modes_for(
            offer(VideoMode(pixel_format="H264", width=640, height=480, rates_hz=())),
            **size,
            rate_hz=30.0,
        )


def test_a_first_frame_that_is_rolled_is_no_reference() -> None:
    """What most of the first frames agree with is; a press and a change of light are no rolls."""
    frames = [grey(each) for each in pictures(640, 480, count=6)]
    whole = [np.frombuffer(each, np.uint8).reshape(480, 640) for each in frames]
    watch = RollWatch()
    seen = [watch.is_rolled(each, PixelFormat.GREY) for each in (np.roll(whole[0], 250), *whole)]
    assert seen[2:] == [False] * 5
    assert watch.is_rolled(np.roll(whole[0], 250, axis=1), PixelFormat.GREY)
    pressed = whole[1].copy()
    pressed[150:330, 230:410] = 60
    brighter = np.asarray(cv2.convertScaleAbs(whole[2], alpha=1.1), np.uint8)
    assert not any(watch.is_rolled(each, PixelFormat.GREY) for each in (pressed, brighter))
