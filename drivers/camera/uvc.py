"""Driver of a UVC camera, or of an MJPEG stream at a URL, through OpenCV.

A thread owns the capture: it opens, grabs, stamps and releases, because each of these can block
for seconds. Nobody waits for it longer than a stated deadline; the age of the newest frame tells
when the camera hangs.

OpenCV hands over the camera's own JPEG bytes in two ways: V4L2 for a camera, FFMPEG for a stream
at a URL. The V4L2 way follows OpenCV's source and has not been tried with a camera yet; the URL
way is what dry runs use.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
import time
import zlib
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import cv2

from drivers.camera.pictures import jpeg_size
from drivers.interfaces import DeviceIdentity, StreamHealth
from drivers.stream_buffer import StreamBuffer, device_holders
from tacauchy_rig.core.config.model import CameraSection, RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ImageFrame

_logger = logging.getLogger(__name__)

_READ_TIMEOUT_S = 10.0
MANUAL_EXPOSURE = 1.0  # V4L2_EXPOSURE_MANUAL; 3 is aperture priority, the usual automatic
_BUFFERED_S = 4.0
_JOIN_TIMEOUT_S = 0.5
_WRONG_FRAMES = 5


class UvcCamera:
    """A camera that delivers the JPEG bytes it sends, untouched; see ``Camera``.

    OpenCV tells no frame numbers, so ``lost_count`` holds only frames that were dropped here
    because nobody drained them; a gap in arrival stamps shows the others. Bytes that are no whole
    JPEG of the asked size count as corrupt, take a number, and are never delivered. Nothing
    reconnects by itself: after a failure make a new object.

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
        self._settings: dict[str, str] = {}
        self._read_count = 0
        self._corrupt_count = 0
        self._other_size: tuple[int, int] | None = None

    def connect(self) -> DeviceIdentity:
        """Open, set the mode, read it back, see the first frame; see ``StreamingDevice``."""
        deadline = time.monotonic() + self._camera.connect_timeout
        found = self._find()
        _quiet_opencv()
        self._thread = threading.Thread(
            target=self._run, args=(found.path,), name="camera", daemon=True
        )
        self._thread.start()
        try:
            if not self._buffer.wait_for_first(timeout_s=deadline - time.monotonic()):
                raise self._no_frame()
        except DeviceError:
            self.close()
            raise
        return DeviceIdentity(
            driver="uvc",
            address=found.path,
            model=found.name or "MJPEG stream",
            serial=found.serial,
            simulated=self._camera.is_emulated
            or (is_url(found.path) and is_on_this_computer(found.path)),
            settings=dict(self._settings),
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

    def _find(self) -> VideoDevice:
        if not is_url(self._camera.device):
            return find_device(self._camera.device)
        probe_url(self._camera.device, timeout_s=self._camera.connect_timeout)
        return VideoDevice(path=self._camera.device)

    def _run(self, path: str) -> None:
        try:
            if is_url(path):
                capture, self._settings = _open_url(path, timeout_s=self._camera.connect_timeout)
            else:
                capture, self._settings = _open_v4l2(path, self._camera)
        except DeviceError as error:
            self._buffer.fail(error)
            return
        asked_s = time.monotonic()
        try:
            has_stamp = self._settings["backend"] == "V4L2"
            while not self._stopping.is_set() and self._read(capture, has_stamp=has_stamp):
                asked_s = time.monotonic()
            if not self._stopping.is_set():
                self._buffer.fail(self._gone(path, waited_s=time.monotonic() - asked_s))
        except cv2.error as error:
            self._buffer.fail(self._gone(path, waited_s=0.0, reason=str(error)))
        finally:
            capture.release()

    def _read(self, capture: cv2.VideoCapture, *, has_stamp: bool) -> bool:
        """Take one frame; False where the camera gives none."""
        if not capture.grab():
            return False
        stamp_ns = time.monotonic_ns()
        device_stamp_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3 if has_stamp else None
        delivered, raw = capture.retrieve()
        if not delivered:
            return False
        jpeg = raw.tobytes()
        self._read_count += 1
        size = jpeg_size(jpeg)
        if size != (self._camera.width, self._camera.height):
            self._corrupt_count += 1
            self._other_size = size or self._other_size
            return self._may_still_come()
        frame = ImageFrame(
            stamp_ns=stamp_ns,
            counter=self._read_count,
            device_stamp_s=device_stamp_s,
            width=size[0],
            height=size[1],
            jpeg=jpeg,
        )
        self._buffer.push(frame, stamp_ns=stamp_ns, fingerprint=zlib.crc32(jpeg))
        return True

    def _may_still_come(self) -> bool:
        """Give up on a camera whose first frames are all whole and of another size."""
        wrong_mode = self._other_size is not None and self._read_count == self._corrupt_count
        if wrong_mode and self._read_count >= _WRONG_FRAMES:
            self._buffer.fail(self._no_frame())
            return False
        return True

    def _gone(self, path: str, *, waited_s: float, reason: str = "") -> DeviceError:
        if not reason and not is_url(path) and not Path(path).exists():
            reason = "it was unplugged"
        elif not reason and waited_s > 0.9 * _READ_TIMEOUT_S:
            reason = f"it sent nothing for {waited_s:.0f} s"
        return DeviceError(
            f"camera: {path} is gone: {reason or 'its stream ended'}",
            remedy="check the cable and power, then start again; nothing reconnects by itself",
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
        if self._read_count:
            return DeviceError(
                f"camera: none of {self._read_count} frames from {device} {waited} is a whole JPEG",
                remedy="check the USB cable, and that no hub shares its bandwidth",
            )
        return DeviceError(
            f"camera: {device} is silent: no frame {waited}",
            remedy="check its cable and power, or raise camera.connect_timeout",
        )


def _quiet_opencv() -> None:
    """Keep OpenCV and FFMPEG from writing to the terminal; their failures reach us otherwise."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def _open_url(url: str, *, timeout_s: float) -> tuple[cv2.VideoCapture, dict[str, str]]:
    """Open a stream for raw packets.

    Raises:
        DeviceError: It is no stream that FFMPEG understands.
    """
    capture = cv2.VideoCapture(
        url,
        cv2.CAP_FFMPEG,
        [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(timeout_s * 1e3)),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(_READ_TIMEOUT_S * 1e3)),
            *(cv2.CAP_PROP_FORMAT, -1),
        ],
    )
    if not capture.isOpened():
        raise DeviceError(
            f"camera: {url} answers but sends no MJPEG stream",
            remedy="check the path in camera.device",
        )
    return capture, {"backend": capture.getBackendName()}


def _open_v4l2(path: str, mode: CameraSection) -> tuple[cv2.VideoCapture, dict[str, str]]:
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
    capture.set(cv2.CAP_PROP_FOURCC, float(cv2.VideoWriter.fourcc(*"MJPG")))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, float(mode.width))
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, float(mode.height))
    capture.set(cv2.CAP_PROP_FPS, mode.rate)
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


def _lock(capture: cv2.VideoCapture, mode: CameraSection) -> None:
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


_PORTS = {"http": 80, "https": 443, "rtsp": 554}


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoDevice:
    """A capture device that the kernel lists; ``serial`` may be empty."""

    path: str
    name: str = ""
    serial: str = ""


def is_url(device: str) -> bool:
    """Return whether ``device`` is the address of a stream."""
    return "://" in device


def is_on_this_computer(url: str) -> bool:
    """Return whether a stream comes from this computer's loopback, as an emulated camera's does."""
    host = urlsplit(url).hostname or ""
    return host == "localhost" or host.startswith("127.") or host == "::1"


def video_devices(
    *, sys_folder: Path = Path("/sys/class/video4linux"), dev_folder: Path = Path("/dev")
) -> list[VideoDevice]:
    """Return the first node (``video-index0``) of every camera present."""
    found = []
    for entry in sorted(sys_folder.glob("video*")):
        if _text(entry / "index") not in ("", "0"):
            continue
        # device is the USB interface; the USB device above it holds the serial number
        serial = _text((entry / "device").resolve().parent / "serial")
        path = str(dev_folder / entry.name)
        found.append(VideoDevice(path=path, name=_text(entry / "name"), serial=serial))
    return found


def find_device(
    wanted: str,
    *,
    sys_folder: Path = Path("/sys/class/video4linux"),
    dev_folder: Path = Path("/dev"),
) -> VideoDevice:
    """Return the one camera that ``wanted`` names, and check that this user may open it.

    Args:
        wanted: Path of a device file, a serial number, or a part of the camera's name.
        sys_folder: Where the kernel lists cameras.
        dev_folder: Where their device files are.

    Raises:
        DeviceError: None or several match, no permission, or in use.
    """
    present = video_devices(sys_folder=sys_folder, dev_folder=dev_folder)
    listed = "; ".join(f"{d.name!r} serial {d.serial or 'none'} at {d.path}" for d in present)
    if wanted.startswith("/"):
        device = _by_path(wanted, present)
    else:
        matches = [d for d in present if d.serial and d.serial == wanted]
        matches = matches or [d for d in present if wanted.casefold() in d.name.casefold()]
        if not wanted or len(matches) != 1:
            several = f"{len(matches)} cameras match" if matches else "no camera matches"
            raise DeviceError(
                f"camera: {several} {wanted!r}; present: {listed or 'none'}",
                remedy="set camera.device to the serial number, the full name, or the path below "
                "/dev/v4l/by-id/ that ends in video-index0; check the USB cable",
            )
        device = matches[0]
    check_access(device)
    return device


def probe_url(url: str, *, timeout_s: float) -> None:
    """See whether anything accepts connections where ``url`` points.

    Raises:
        DeviceError: Nothing does.
    """
    parts = urlsplit(url)
    address = (parts.hostname or "", parts.port or _PORTS.get(parts.scheme, 80))
    try:
        socket.create_connection(address, timeout=timeout_s).close()
    except OSError as error:
        raise DeviceError(
            f"camera: nothing answers at {url} ({error})",
            remedy="check that the stream is running and camera.device is its address",
        ) from error


def _by_path(path: str, present: list[VideoDevice]) -> VideoDevice:
    if not Path(path).exists():
        listed = ", ".join(device.path for device in present)
        raise DeviceError(
            f"camera: {path} does not exist",
            remedy=f"check the USB cable; cameras present now: {listed or 'none'}",
        )
    real = os.path.realpath(path)
    for device in present:
        if os.path.realpath(device.path) == real:
            return VideoDevice(path=path, name=device.name, serial=device.serial)
    return VideoDevice(path=path)


def check_access(device: VideoDevice) -> None:
    """See whether this user may open the camera and nobody else holds it.

    Raises:
        DeviceError: No permission, or in use.
    """
    if not os.access(device.path, os.R_OK | os.W_OK, effective_ids=True):
        raise DeviceError(
            f"camera: no permission to open {device.path}",
            remedy="sudo usermod -aG video $USER, then log out and in again",
        )
    holders = device_holders(device.path)
    if holders:
        raise DeviceError(
            f"camera: {device.path} is in use by {', '.join(holders)}",
            remedy=f"end that program; `fuser -v {device.path}` names it",
        )


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""
