"""Driver of a UVC camera, or of an MJPEG stream at a URL, through OpenCV.

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
from pathlib import Path

import cv2
import numpy as np

from drivers.camera.choice import VideoDevice, find_device, is_on_this_computer, is_url, probe_url
from drivers.camera.jpeg_checks import jpeg_size
from drivers.camera.opening_and_exposure import READ_TIMEOUT_S, Capture, open_camera, open_url
from drivers.camera.uncompressed_frames import RollWatch, encoded, frame_shape, is_jpeg
from drivers.camera.v4l2_modes import PixelFormat
from drivers.interfaces import DeviceIdentity, StreamHealth
from drivers.stream_buffer_and_repeats import StreamBuffer
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ImageFrame

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
