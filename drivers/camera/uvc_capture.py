"""Open cv2.VideoCapture so that it hands over the camera's own JPEG bytes.

Two ways in: V4L2 for a camera, FFMPEG for a stream at a URL. The V4L2 way follows OpenCV's source
and has not been tried with a camera yet; the URL way is what dry runs use.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass

import cv2

from tacauchy_rig.errors import DeviceError

_logger = logging.getLogger(__name__)

READ_TIMEOUT_S = 10.0
MANUAL_EXPOSURE = 1.0  # V4L2_EXPOSURE_MANUAL; 3 is aperture priority, the usual automatic


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMode:
    """What is asked of a camera.

    Attributes:
        width: Pixels; so is ``height``.
        rate_hz: Frames per second [Hz].
        exposure: In the driver's own unit, like ``gain``; ``white_balance`` in kelvin. Locked
            where given, left as they are where None.
    """

    width: int
    height: int
    rate_hz: float
    exposure: int | None = None
    gain: int | None = None
    white_balance: int | None = None


def quiet_opencv() -> None:
    """Keep OpenCV and FFMPEG from writing to the terminal; their failures reach us otherwise."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def open_url(url: str, *, timeout_s: float) -> tuple[cv2.VideoCapture, dict[str, str]]:
    """Open a stream for raw packets.

    Raises:
        DeviceError: It is no stream that FFMPEG understands.
    """
    capture = cv2.VideoCapture(
        url,
        cv2.CAP_FFMPEG,
        [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(timeout_s * 1e3)),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(READ_TIMEOUT_S * 1e3)),
            *(cv2.CAP_PROP_FORMAT, -1),
        ],
    )
    if not capture.isOpened():
        raise DeviceError(
            f"camera: {url} answers but sends no MJPEG stream",
            remedy="check the path in camera.device",
        )
    return capture, {"backend": capture.getBackendName()}


def open_v4l2(path: str, mode: CameraMode) -> tuple[cv2.VideoCapture, dict[str, str]]:
    """Open a camera for raw MJPEG, lock what is asked, and read everything back.

    Raises:
        DeviceError: It cannot be opened, or takes another mode than asked.
    """
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
    if not capture.isOpened():
        raise DeviceError(
            f"camera: {path} does not open as a V4L2 camera",
            remedy="unplug it and plug it in again; check `v4l2-ctl --list-devices`",
        )
    # The order matters: a later format change would undo size and rate.
    capture.set(cv2.CAP_PROP_FOURCC, float(_fourcc("MJPG")))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, float(mode.width))
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, float(mode.height))
    capture.set(cv2.CAP_PROP_FPS, mode.rate_hz)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 4.0)
    capture.set(cv2.CAP_PROP_CONVERT_RGB, 0.0)
    _lock(capture, mode)
    settings = _read_back(capture)
    asked = {"fourcc": "MJPG", "width": str(mode.width), "height": str(mode.height)}
    wrong = [
        f"{key} {settings[key]} instead of {asked[key]}"
        for key in asked
        if settings[key] != asked[key]
    ]
    if wrong:
        capture.release()
        raise DeviceError(
            f"camera: {path} took another mode: {', '.join(wrong)}",
            remedy=f"`v4l2-ctl -d {path} --list-formats-ext` lists what it can do",
        )
    return capture, settings


def _lock(capture: cv2.VideoCapture, mode: CameraMode) -> None:
    if mode.exposure is not None:
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE)
        _set_checked(capture, "exposure", cv2.CAP_PROP_EXPOSURE, mode.exposure)
    if mode.gain is not None:
        _set_checked(capture, "gain", cv2.CAP_PROP_GAIN, mode.gain)
    if mode.white_balance is not None:
        capture.set(cv2.CAP_PROP_AUTO_WB, 0.0)
        _set_checked(capture, "white balance", cv2.CAP_PROP_WB_TEMPERATURE, mode.white_balance)


def _set_checked(capture: cv2.VideoCapture, name: str, prop: int, value: int) -> None:
    capture.set(prop, float(value))
    got = capture.get(prop)
    if got != value:
        _logger.warning("camera: %s was set to %d and reads back %g", name, value, got)


def _read_back(capture: cv2.VideoCapture) -> dict[str, str]:
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    return {
        "backend": capture.getBackendName(),
        "fourcc": code.to_bytes(4, "little").decode("ascii", "replace"),
        "width": f"{capture.get(cv2.CAP_PROP_FRAME_WIDTH):.0f}",
        "height": f"{capture.get(cv2.CAP_PROP_FRAME_HEIGHT):.0f}",
        "rate_hz": f"{capture.get(cv2.CAP_PROP_FPS):g}",
        "auto_exposure": f"{capture.get(cv2.CAP_PROP_AUTO_EXPOSURE):g}",
        "exposure": f"{capture.get(cv2.CAP_PROP_EXPOSURE):g}",
        "gain": f"{capture.get(cv2.CAP_PROP_GAIN):g}",
        "auto_white_balance": f"{capture.get(cv2.CAP_PROP_AUTO_WB):g}",
        "white_balance": f"{capture.get(cv2.CAP_PROP_WB_TEMPERATURE):g}",
    }


def _fourcc(text: str) -> int:
    return int.from_bytes(text.encode("ascii"), "little")
