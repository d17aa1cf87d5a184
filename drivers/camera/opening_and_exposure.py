"""Open a camera through OpenCV: its mode, and the lock of exposure, gain, white balance and lamps.

OpenCV hands over the camera's own bytes in two ways: V4L2 for a camera, FFMPEG for a stream at a
URL.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2

from drivers.camera.uncompressed_frames import RECORDED_AS
from drivers.camera.v4l2_modes import Offer, PixelFormat, VideoMode, modes_for, read_offer
from drivers.interfaces import MANUAL_EXPOSURE
from tacauchy_rig.core.config.settings import CameraSection
from tacauchy_rig.core.errors import DeviceError

READ_TIMEOUT_S = 10.0
"""How long OpenCV waits for a frame; with V4L2 that cannot be set."""
_PLAYED = frozenset({"emulated", "vivid", "v4l2 loopback"})
"""Drivers without hardware: our emulated device and two of the kernel."""
_LED_READS_MOST = 255
"""A DIGIT reads back no more of its lamps' 12 bits than that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """A capture that is open for raw frames."""

    stream: cv2.VideoCapture
    settings: dict[str, str]  # what it says of its mode and controls, for the record
    pixel_format: PixelFormat = PixelFormat.MJPG  # of the bytes that it hands over
    is_played: bool = False  # whether software stands in for the camera, as far as it says
    model: str = ""


def open_url(url: str, *, timeout_s: float) -> Capture:
    """Open a stream for raw packets.

    Raises:
        DeviceError: It is no stream that FFMPEG understands.
    """
    stream = cv2.VideoCapture(
        url,
        cv2.CAP_FFMPEG,
        [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(timeout_s * 1e3)),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(READ_TIMEOUT_S * 1e3)),
            *(cv2.CAP_PROP_FORMAT, -1),
        ],
    )
    if not stream.isOpened():
        raise DeviceError(
            f"camera: {url} answers but sends no MJPEG stream",
            remedy="check the path in camera.device",
        )
    return Capture(stream=stream, settings={"backend": stream.getBackendName()})


def open_camera(path: str, camera: CameraSection) -> Capture:
    """Open a V4L2 camera in the best format that it offers and takes, and lock its controls.

    Nothing is set once frames are read: a DIGIT whose rate is changed then sends nothing until it
    is unplugged.

    Raises:
        DeviceError: It cannot be opened, has no such size, or refuses what is asked.
    """
    offer = read_offer(path)
    modes = modes_for(offer, width=camera.width, height=camera.height, rate_hz=camera.rate)
    stream = cv2.VideoCapture(path, cv2.CAP_V4L2)
    if not stream.isOpened():
        raise DeviceError(
            f"camera: {path} does not open as a V4L2 camera",
            remedy="unplug it and plug it in again; check `v4l2-ctl --list-devices`",
        )
    try:
        mode = next((mode for mode in modes if _takes(stream, mode, camera.rate)), None)
        if mode is None:
            raise DeviceError(
                f"camera: {offer.card} refuses {', '.join(map(str, modes))}, which it offers",
                remedy="unplug it and plug it in again; end other programs that use it",
            )
        locked = dict(_lock(stream, camera, offer))
    except DeviceError:
        stream.release()
        raise
    return Capture(
        stream=stream,
        settings={**_read_back(stream, mode), **locked},
        pixel_format=PixelFormat(mode.pixel_format),
        is_played=offer.driver in _PLAYED,
        model=offer.card,
    )


def _takes(stream: cv2.VideoCapture, mode: VideoMode, rate_hz: float) -> bool:
    """Set a mode; return whether it reads back. A later format would undo size and rate."""
    code = PixelFormat(mode.pixel_format).code
    stream.set(cv2.CAP_PROP_FOURCC, float(code))
    stream.set(cv2.CAP_PROP_FRAME_WIDTH, float(mode.width))
    stream.set(cv2.CAP_PROP_FRAME_HEIGHT, float(mode.height))
    stream.set(cv2.CAP_PROP_FPS, mode.rate_for(rate_hz))
    stream.set(cv2.CAP_PROP_CONVERT_RGB, 0.0)
    properties = (cv2.CAP_PROP_FOURCC, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    return [int(stream.get(each)) for each in properties] == [code, mode.width, mode.height]


def _lock(
    stream: cv2.VideoCapture, camera: CameraSection, offer: Offer
) -> Iterator[tuple[str, str]]:
    """Set what the configuration states and read it back."""
    if camera.exposure is not None:
        stream.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE)
        _set(stream, "exposure", cv2.CAP_PROP_EXPOSURE, camera.exposure, offer)
    if camera.gain is not None:
        _set(stream, "gain", cv2.CAP_PROP_GAIN, camera.gain, offer)
    if camera.white_balance is not None:
        stream.set(cv2.CAP_PROP_AUTO_WB, 0.0)
        white = camera.white_balance
        _set(stream, "white_balance", cv2.CAP_PROP_WB_TEMPERATURE, white, offer)
    if camera.leds is not None:
        red, green, blue = camera.leds
        _set(stream, "leds", cv2.CAP_PROP_ZOOM, red << 8 | green << 4 | blue, offer)
        yield "leds", f"{red} {green} {blue}"


def _set(stream: cv2.VideoCapture, name: str, prop: int, value: int, offer: Offer) -> None:
    field = f"camera.{name}"
    if name not in offer.ranges:
        raise DeviceError(
            f"camera: {offer.card} has no control for {field}",
            remedy=f"leave {field} out; `v4l2-ctl --list-ctrls` lists what it has",
        )
    least, most, step = offer.ranges[name]
    stream.set(prop, float(value))
    got = stream.get(prop)
    expected = min(value, _LED_READS_MOST) if name == "leds" else value
    if got != value and abs(got - expected) >= step:
        raise DeviceError(
            f"camera: {field} was set to {value} and reads back {got:g}",
            remedy=f"{offer.card} takes {least} to {most} in steps of {step}; close other programs "
            "that set it",
        )


def _read_back(stream: cv2.VideoCapture, mode: VideoMode) -> dict[str, str]:
    properties = {
        "width": cv2.CAP_PROP_FRAME_WIDTH,
        "height": cv2.CAP_PROP_FRAME_HEIGHT,
        "rate_hz": cv2.CAP_PROP_FPS,
        "auto_exposure": cv2.CAP_PROP_AUTO_EXPOSURE,
        "exposure": cv2.CAP_PROP_EXPOSURE,
        "gain": cv2.CAP_PROP_GAIN,
        "auto_white_balance": cv2.CAP_PROP_AUTO_WB,
        "white_balance": cv2.CAP_PROP_WB_TEMPERATURE,
    }
    found = {name: f"{stream.get(each):g}" for name, each in properties.items()}
    is_raw = mode.pixel_format != PixelFormat.MJPG
    recorded = {"recorded_as": RECORDED_AS} if is_raw else {}
    return {"backend": stream.getBackendName(), "fourcc": mode.pixel_format, **recorded, **found}
