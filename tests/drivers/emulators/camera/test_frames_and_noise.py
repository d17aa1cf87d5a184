"""The emulated camera as its clients see it: real cv2.VideoCapture, raw packets, faults."""

import itertools
import math
import re
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from drivers.emulators.camera.frames_and_noise import (
    EmulatedCamera,
    FrameFactory,
    PressKey,
    garbled,
)
from drivers.emulators.faults import parse_fault
from drivers.emulators.plant.gel_image_and_lights import render_press
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import CylinderTip, draw_truth, write_truth
from drivers.emulators.process import DeviceSettings, EmulatedProcess, command_line, post_fault
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import Pose
from tests.drivers.conftest import changed

SURFACE_Z = 0.2
TRUTH = draw_truth(7)
PUNCH = CylinderTip(diameter_m=5e-3)


@pytest.fixture(scope="module")
def factory() -> FrameFactory:
    """Return a factory of 640x480 frames."""
    plant = Plant(TRUTH, PUNCH, (0.0, 0.0, SURFACE_Z))
    return FrameFactory(plant, 640, 480)


def _decoded(jpeg: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)


def test_frames_show_the_press_without_seams(factory: FrameFactory) -> None:
    """A frame of which a part is rendered is the whole picture, to within noise and JPEG."""
    key = PressKey(depth=125, x=20, y=-30)
    factory.prepare(key)
    assert factory.newest == key
    frame = _decoded(factory.compose())
    expected = render_press(
        TRUTH, PUNCH, 0.5e-3, (640, 480), centre_m=(2e-4, -3e-4), noise_seed=None
    )
    difference = cv2.GaussianBlur(frame.astype(np.float32) - expected, (0, 0), 4)
    assert np.abs(difference).max() < 2.5


def test_frames_differ_by_noise(factory: FrameFactory) -> None:
    """Temporal noise is real: no two frames are the same bytes, and what differs has its size."""
    factory.prepare(PressKey())
    sent = [factory.compose() for _ in range(50)]
    assert len(set(sent)) == len(sent)
    frames = [_decoded(jpeg).astype(float) for jpeg in sent[:6]]
    changes = [np.std(b - a) for a, b in itertools.pairwise(frames)]
    assert min(changes) > 0.3
    assert max(changes) < 2.0 * TRUTH.image_noise_levels


def test_the_light_of_the_unloaded_gel_drifts(factory: FrameFactory) -> None:
    """In dimmer light the frame is dimmer."""
    factory.prepare(PressKey())
    before = _decoded(factory.compose()).mean()
    factory.prepare(PressKey(light=-20))
    after = _decoded(factory.compose()).mean()
    assert after == pytest.approx(before * 0.96 ** (1 / 2.2), rel=0.01)
    factory.prepare(PressKey())


@dataclass(frozen=True, slots=True)
class RunningCamera:
    """An emulated camera in its own process."""

    process: subprocess.Popen[bytes]
    folder: Path
    ready: dict[str, Any]
    world: SharedWorld

    def press(self, depth_m: float) -> None:
        """Put the arm where the tip is ``depth_m`` deep in the gel."""
        press(self.world, depth_m)


def press(world: SharedWorld, depth_m: float) -> None:
    """Put the arm of a world where the tip is ``depth_m`` deep in the gel."""
    z = SURFACE_Z + TRUTH.surface_error_m - depth_m
    pose = Pose(position=(0.0, 0.0, z), rotation_vector=(0.0, math.pi, 0.0))
    world.publish(pose, time.monotonic_ns())


class SlowFactory(FrameFactory):
    """A factory that takes several frames' time for each contact."""

    def _rendered(self, _key: PressKey) -> None:
        time.sleep(0.03)

    def compose(self, *, overexposed: bool = False) -> bytes:
        """Return no picture."""
        return bytes([self.newest.depth % 256, overexposed])


def test_a_press_that_is_rendered_slowly_is_seen_late_and_not_still(tmp_path: Path) -> None:
    """The image follows the depth while no depth is waited for until it has been rendered."""
    with closing(SharedWorld.create(tmp_path / "world.bin")) as world:
        factory = SlowFactory(Plant(TRUTH, PUNCH, (0.0, 0.0, SURFACE_Z)), 320, 240)
        settings, service = camera_settings(tmp_path, rate=100.0), Mock()
        service.faults_at.return_value = []
        camera = EmulatedCamera(settings, service, factory, garbled, Mock())
        shown = set()
        for number in range(30):
            press(world, number * 1e-5)
            camera._frame(time.monotonic())
            shown.add(factory.newest.depth)
        camera.close()
    assert len(shown) >= 4


def camera_settings(folder: Path, *, rate: float = 25.0) -> DeviceSettings:
    """Return those of a camera at 640x480 over the gel of the seed 7."""
    config = changed(
        load_config().config,
        camera={"rate": rate},
        sensor={"surface": (0.0, 0.0, SURFACE_Z)},
        emulation={"seed": 7},
    )
    write_truth(folder, TRUTH)
    return DeviceSettings(folder=folder, config=config)


@pytest.fixture
def camera(tmp_path: Path) -> Iterator[RunningCamera]:
    """Start an emulated camera of 640x480 at 25 fps."""
    world = SharedWorld.create(tmp_path / "world.bin")
    camera = EmulatedProcess("camera", "camera.frames_and_noise", camera_settings(tmp_path))
    yield RunningCamera(camera.process, tmp_path, camera.wait_ready(), world)
    camera.stop()
    assert camera.process.returncode == 0
    world.close()


@pytest.fixture
def capture(camera: RunningCamera) -> Iterator[cv2.VideoCapture]:
    """Open the camera with OpenCV, as the driver does."""
    capture = cv2.VideoCapture(
        camera.ready["url"], cv2.CAP_FFMPEG, [cv2.CAP_PROP_READ_TIMEOUT_MSEC, 1500]
    )
    assert capture.isOpened()
    yield capture
    capture.release()


def test_opencv_reads_every_frame(camera: RunningCamera, capture: cv2.VideoCapture) -> None:
    """Two seconds through cv2.VideoCapture: size as asked, each frame new, none before its time."""
    frames = [capture.read()[1] for _ in range(50)]
    passed_s = (time.monotonic_ns() - camera.ready["first_capture_ns"]) * 1e-9
    assert frames[0].shape == (480, 640, 3)
    assert len({frame.tobytes() for frame in frames}) == len(frames)
    assert passed_s > 49 / 25.0 + camera.ready["latency_s"]


def test_a_press_becomes_visible(camera: RunningCamera, capture: cv2.VideoCapture) -> None:
    """The gel is unloaded until the arm's pose presses it, and recovers when it leaves."""

    def frame_after(depth_m: float) -> np.ndarray:
        camera.press(depth_m)
        return [capture.read()[1] for _ in range(12)][-1].astype(float)

    rest, pressed, left = (frame_after(depth) for depth in (-1e-3, 0.5e-3, -1e-3))
    assert np.abs(pressed - rest).max() > 40.0
    assert np.abs(left - rest).max() < 25.0


def test_raw_packets_are_what_was_sent(camera: RunningCamera) -> None:
    """CAP_PROP_FORMAT -1 hands out the bytes of the HTTP parts, untouched."""
    raw = cv2.VideoCapture(camera.ready["url"], cv2.CAP_FFMPEG)
    assert raw.set(cv2.CAP_PROP_FORMAT, -1)
    with urllib.request.urlopen(camera.ready["url"], timeout=5) as response:  # noqa: S310
        packets, sent = set(), set()
        for _ in range(20):
            packets.add(raw.read()[1].tobytes())
            head = b"".join(iter(response.readline, b"\r\n"))
            length = int(re.search(rb"Content-Length: (\d+)", head)[1])  # type: ignore[index]
            sent.add(response.read(length))
            response.readline()
    raw.release()
    both = packets & sent
    assert len(both) >= 10
    assert all(jpeg.startswith(b"\xff\xd8") and jpeg.endswith(b"\xff\xd9") for jpeg in both)


def test_faults_reach_a_running_camera(camera: RunningCamera, capture: cv2.VideoCapture) -> None:
    """A frozen image repeats, so does a loop, saturation is bright, unplugging closes the port."""
    post_fault(camera.folder, parse_fault("camera:freeze-image+500ms"))
    shown = [capture.read()[1].tobytes() for _ in range(20)]
    assert len(set(shown)) < 15
    post_fault(camera.folder, parse_fault("camera:repeat-image=3+800ms"))
    shown = [capture.read()[1].tobytes() for _ in range(20)]
    assert max(map(shown.count, shown)) >= 4
    assert all(before != after for before, after in itertools.pairwise(shown))
    post_fault(camera.folder, parse_fault("camera:saturate+500ms"))
    assert max(capture.read()[1].mean() for _ in range(15)) > 225.0
    post_fault(camera.folder, parse_fault("camera:unplug+4s"))
    assert not all(capture.read()[0] for _ in range(50))
    address = re.search(r"//(.*):(\d+)/", camera.ready["url"])
    assert address is not None
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((address[1], int(address[2])), timeout=2)
    end_s = time.monotonic() + 20.0
    while not cv2.VideoCapture(camera.ready["url"], cv2.CAP_FFMPEG).isOpened():
        assert time.monotonic() < end_s, "the plug was to be put in again after 4 s"
        time.sleep(0.2)
    assert camera.process.poll() is None


def test_a_taken_port_is_said(camera: RunningCamera, tmp_path: Path) -> None:
    """The message names the address and the remedy; no traceback."""
    port = int(camera.ready["url"].rsplit(":", 1)[1].split("/")[0])
    other = replace(camera_settings(tmp_path / "other"), port=port)
    found = subprocess.run(
        command_line("camera.frames_and_noise", other), capture_output=True, check=False
    )
    assert found.returncode == 2
    assert f"127.0.0.1:{port} cannot be listened on" in found.stderr.decode()
    assert "Traceback" not in found.stderr.decode()
