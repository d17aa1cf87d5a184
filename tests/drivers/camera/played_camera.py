"""What a program sees of a V4L2 device that is preloaded into it; the tests' other process.

Each line of the standard input asks for something, as JSON: mostly for one connection, with
overrides of the configuration and how many frames to take. The answer is one line of JSON.
"""

import base64
import json
import sys
import time
from typing import Any

import cv2

from drivers.camera.uvc_camera import UvcCamera
from drivers.device_checks import device_checks
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError

GIVE_UP_S = 10.0


def taken(overrides: list[str], count: int) -> dict[str, Any]:
    """Connect, take frames until there are ``count`` or the camera fails, and close."""
    camera = UvcCamera(load_config(overrides=overrides).config)
    found: dict[str, Any] = {"frames": [], "error": "", "remedy": ""}
    end_s = time.monotonic() + GIVE_UP_S
    try:
        identity = camera.connect()
        found.update(model=identity.model, settings=identity.settings, played=identity.simulated)
        while len(found["frames"]) < count and time.monotonic() < end_s:
            time.sleep(0.005)
            frames = camera.drain()
            found["frames"] += [base64.b64encode(frame.jpeg).decode() for frame in frames]
    except DeviceError as error:
        found.update(error=error.message, remedy=error.remedy)
    found["corrupt"] = camera.health().corrupt_count
    camera.close()
    return found


def wedge(path: str) -> None:
    """Change the rate of a camera while it streams, as a program should not."""
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
    capture.grab()
    capture.set(cv2.CAP_PROP_FPS, 15.0)
    capture.release()


for line in sys.stdin:
    asked = json.loads(line)
    answer: dict[str, Any] = {}
    if "wedge" in asked:
        wedge(asked["wedge"])
    elif "measure_s" in asked:
        config = load_config(overrides=asked["overrides"]).config
        checks = device_checks(config, measure_s=asked["measure_s"])
        answer = {check.name: [check.status.value, check.finding] for check in checks}
    else:
        answer = taken(asked["overrides"], asked["count"])
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()
