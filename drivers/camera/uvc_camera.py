"""Driver of a UVC camera, or of an MJPEG stream at a URL, through OpenCV.

OpenCV hands over the camera's own bytes in two ways: V4L2 for a camera, FFMPEG for a stream at a
URL. Opening sets the mode and locks exposure, gain, white balance and lamps.

A thread owns the capture: it opens, grabs, stamps and releases, because each of these can block
for seconds. Nobody waits for it longer than a stated deadline; the age of the newest frame tells
when the camera hangs.

JPEG is recorded as it comes; YUYV, NV12 and grey frames are encoded here. The V4L2 way is tested
with OpenCV and a preloaded library that plays a camera, not with a camera; most dry runs use the
URL way.
"""

import os
import threading
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from drivers.camera.choice import VideoDevice, find_device, is_on_this_computer, is_url, probe_url
from drivers.camera.frame_checks import jpeg_size
from drivers.camera.uncompressed_frames import RECORDED_AS, RollWatch, encoded, frame_shape, is_jpeg
from drivers.camera.v4l2_modes import Offer, PixelFormat, VideoMode, modes_for, read_offer
from drivers.interfaces import MANUAL_EXPOSURE, DeviceIdentity, StreamHealth
from drivers.stream_buffer_and_repeats import StreamBuffer
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.settings import CameraSection, RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ImageFrame

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


_BUFFERED_S = 4.0
_JOIN_TIMEOUT_S = 0.5
_WRONG_FRAMES = 5


class UvcCamera:
    """A camera that delivers the JPEG bytes it sends, untouched; see ``Camera``.

    One that sends no JPEG is recorded as JPEG of high quality. OpenCV tells no frame numbers, so
    ``lost_count`` holds only frames that were dropped here because nobody drained them; a gap in
    arrival stamps shows the others. Bytes that are no whole frame of the asked size, or rolled
    sideways, count as corrupt, take a number, and are never delivered. Nothing reconnects by
    itself: after a failure make a new object.

    Args:
        config: Which camera, in which mode; ``camera.connect_timeout`` is from opening to the
            first valid frame. An emulated camera is this one at its URL, and a stream from this
            computer itself is recorded as simulated whatever the driver is called.
    """

    def __init__(self, config: RigConfig) -> None:
        camera = self._camera = config.camera
        self._buffer = StreamBuffer[ImageFrame](capacity=max(8, int(_BUFFERED_S * camera.rate)))
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._capture: Capture | None = None
        self._rolls = RollWatch()
        self._read_count = 0
        self._corrupt_count = 0
        self._other_size: tuple[int, int] | None = None
        self._other_format = ""

    def connect(self) -> DeviceIdentity:
        """Open, set the mode, read it back, see the first frame; see ``StreamingDevice``."""
        deadline = time.monotonic() + self._camera.connect_timeout
        device = self._camera.device
        if is_url(device):
            probe_url(device, timeout_s=self._camera.connect_timeout)
        found = VideoDevice(path=device) if is_url(device) else find_device(device)
        # OpenCV and FFMPEG write nothing to the terminal; their failures reach us otherwise.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._thread = threading.Thread(
            target=self._run, args=(found.path,), name="camera", daemon=True
        )
        self._thread.start()
        try:
            has_frame = self._buffer.wait_for_first(timeout_s=deadline - time.monotonic())
            if not has_frame or (capture := self._capture) is None:
                raise self._no_frame()
        except DeviceError:
            self.close()
            raise
        is_here = is_url(found.path) and is_on_this_computer(found.path)
        return DeviceIdentity(
            driver="uvc",
            address=found.path,
            model=found.name or capture.model or "MJPEG stream",
            serial=found.serial,
            simulated=self._camera.is_emulated or capture.is_played or is_here,
            settings=dict(capture.settings),
        )

    def drain(self) -> list[ImageFrame]:
        """Return every frame that arrived since the last call; see ``StreamingDevice``."""
        return self._buffer.drain()

    def health(self) -> StreamHealth:
        """Return counts, age and rate; ``repeat_count`` is the run of equal frames now."""
        return self._buffer.health(lost_count=0, corrupt_count=self._corrupt_count)

    def close(self) -> None:
        """Release the camera. Safe to call twice.

        A read that is blocked in OpenCV is left to end by itself; its thread then releases.
        """
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(_JOIN_TIMEOUT_S)

    def _run(self, path: str) -> None:
        camera = self._camera
        try:
            if is_url(path):
                capture = open_url(path, timeout_s=camera.connect_timeout)
            else:
                capture = open_camera(path, camera)
        except DeviceError as error:
            self._buffer.fail(error)
            return
        self._capture = capture
        asked_s = time.monotonic()
        try:
            while not self._stopping.is_set() and self._read(capture):
                asked_s = time.monotonic()
            if not self._stopping.is_set():
                self._buffer.fail(self._gone(path, waited_s=time.monotonic() - asked_s))
        except cv2.error as error:
            self._buffer.fail(self._gone(path, waited_s=0.0, reason=str(error)))
        finally:
            capture.stream.release()

    def _read(self, capture: Capture) -> bool:
        """Take one frame; False where the camera gives none."""
        stream = capture.stream
        grabbed, stamp_ns = stream.grab(), time.monotonic_ns()
        has_stamp = grabbed and capture.settings["backend"] == "V4L2"
        device_stamp_s = stream.get(cv2.CAP_PROP_POS_MSEC) * 1e-3 if has_stamp else None
        delivered, raw = stream.retrieve() if grabbed else (False, None)
        if not delivered:
            return False
        self._read_count += 1
        jpeg = self._checked(np.asarray(raw, np.uint8), capture.pixel_format)
        if jpeg is None:
            self._corrupt_count += 1
            return self._may_still_come()
        frame = ImageFrame(
            stamp_ns=stamp_ns,
            counter=self._read_count,
            device_stamp_s=device_stamp_s,
            width=self._camera.width,
            height=self._camera.height,
            jpeg=jpeg,
        )
        self._buffer.push(frame, stamp_ns=stamp_ns, fingerprint=zlib.crc32(jpeg))
        return True

    def _checked(self, raw: ImageArray, pixel_format: PixelFormat) -> bytes | None:
        """Return the JPEG of a frame; None where its bytes are not what they should be."""
        wanted = self._camera.width, self._camera.height
        if pixel_format is PixelFormat.MJPG:
            jpeg = raw.tobytes()
            size = jpeg_size(jpeg)
            self._other_size = self._other_size if size in (None, wanted) else size
            return jpeg if size == wanted else None
        if is_jpeg(raw):
            self._other_format = f"JPEG instead of {pixel_format.value}"
            return None
        if raw.shape != frame_shape(pixel_format, *wanted):
            return None
        return None if self._rolls.is_rolled(raw, pixel_format) else encoded(raw, pixel_format)

    def _may_still_come(self) -> bool:
        """Give up on a camera whose first frames are all whole and not what was asked for."""
        wrong_mode = self._other_size is not None or self._other_format
        if wrong_mode and self._corrupt_count == self._read_count >= _WRONG_FRAMES:
            self._buffer.fail(self._no_frame())
            return False
        return True

    def _gone(self, path: str, *, waited_s: float, reason: str = "") -> DeviceError:
        if not reason and not is_url(path) and not Path(path).exists():
            reason = "it was unplugged"
        elif not reason and waited_s > 0.9 * READ_TIMEOUT_S:
            reason = f"it sent nothing for {waited_s:.0f} s"
        return DeviceError(
            f"camera: {path} is gone: {reason or 'its stream ended'}",
            remedy="check the cable and power; nothing reconnects by itself",
        )

    def _no_frame(self) -> DeviceError:
        device, waited = self._camera.device, f"in {self._camera.connect_timeout:g} s"
        if self._other_size is not None:
            width, height = self._other_size
            return DeviceError(
                f"camera: {device} sends {width}x{height} px instead of "
                f"{self._camera.width}x{self._camera.height} px",
                remedy="set camera.width and camera.height to what it sends, or change its mode",
            )
        if self._other_format:
            return DeviceError(
                f"camera: {device} sends {self._other_format}",
                remedy="unplug it and plug it in again",
            )
        if self._read_count:
            return DeviceError(
                f"camera: none of {self._read_count} frames from {device} {waited} is whole",
                remedy="check the USB cable, and that no hub shares its bandwidth",
            )
        return DeviceError(
            f"camera: {device} is silent: no frame {waited}",
            remedy="unplug it and plug it in again: a DIGIT whose rate was changed while it "
            "streamed needs that; or raise camera.connect_timeout",
        )
