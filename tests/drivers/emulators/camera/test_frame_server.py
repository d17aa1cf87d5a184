"""The emulated camera as a V4L2 device: what it sends, and the processes that see it."""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drivers.camera.v4l2_modes import PixelFormat
from drivers.emulators.camera.frames_and_noise import (
    description_of,
    encode_jpeg,
    encode_yuyv,
    encoder_of,
    without_a_packet,
)
from drivers.emulators.faults import Device
from drivers.emulators.launch import Emulation
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import VideoDeviceName

ROOT = Path(__file__).parents[4]


@pytest.mark.parametrize("name", list(VideoDeviceName))
def test_each_device_offers_what_its_sensor_file_asks_for(name: VideoDeviceName) -> None:
    """The modes of its description hold the rate that the sensor's camera delivers."""
    modes = [line.split() for line in description_of(name).splitlines() if line[:5] == "mode "]
    config = load_config(overrides=[f"sensor.name={name.value}"]).config
    assert all(mode[1] in set(PixelFormat) for mode in modes)
    assert max(float(rate) for rate in modes[0][4:]) >= config.camera.rate
    assert config.camera.rate > config.protocol.min_image_rate


def test_frames_are_in_the_format_of_the_device() -> None:
    """A Mini sends JPEG, a DIGIT two bytes a pixel."""
    assert encoder_of(VideoDeviceName.GELSIGHT_MINI) is encode_jpeg
    assert encoder_of(VideoDeviceName.DIGIT) is encode_yuyv
    assert len(encode_yuyv(np.zeros((48, 64, 3), np.uint8))) == 2 * 48 * 64


def test_a_lost_packet_moves_the_rest_up() -> None:
    """What lies before it stays, what follows comes 3060 bytes earlier."""
    frame = np.random.default_rng(1).integers(0, 255, 640 * 480 * 2, dtype=np.uint8).tobytes()
    source = random.Random(5)  # noqa: S311 - a fault, not a secret
    damaged = without_a_packet(frame, source).split(b"\0", 2)[2]
    start = next(i for i, (a, b) in enumerate(zip(frame, damaged, strict=False)) if a != b)
    assert len(damaged) == len(frame) - 3060
    assert damaged[start:] == frame[start + 3060 :]


@pytest.mark.slow
def test_the_processes_of_a_run_see_the_device(tmp_path: Path) -> None:
    """From its start to its end the emulation lends its children the device, and no longer."""
    overrides = [
        "sensor.name=digit",
        "emulation.video_device=digit",
        "camera.width=320",
        "camera.height=240",
    ]
    config = load_config(overrides=overrides).config
    read = (
        "import sys; from tests.drivers.camera.played_camera import taken; import json;"
        "print(json.dumps(taken(json.loads(sys.argv[1]), 3)))"
    )
    with Emulation(config, folder=tmp_path, devices=frozenset({Device.CAMERA})) as emulation:
        device = emulation.running.camera.device
        assert os.environ["VIDEO_DEVICE"] == device == str(tmp_path / "video0")
        asked = json.dumps([*overrides, f"camera.device={device}"])
        command = [sys.executable, "-c", read, asked]
        found = subprocess.run(
            command, capture_output=True, text=True, cwd=ROOT, stdin=subprocess.DEVNULL, check=True
        )
    answer = json.loads(found.stdout)
    assert (answer["error"], answer["settings"]["fourcc"]) == ("", "YUYV")
    assert len(answer["frames"]) >= 3
    assert "VIDEO_DEVICE" not in os.environ
    assert "LD_PRELOAD" not in os.environ
    assert not Path(device).exists()
