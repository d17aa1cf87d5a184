"""What a camera offers, asked of the kernel.

OpenCV streams from a camera but cannot list what it offers. The numbers are those of
``linux/videodev2.h``; a test compares them with a compiler's.
"""

import errno
import fcntl
import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from tacauchy_rig.core.errors import DeviceError

_CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
_DISCRETE = 1
_DISABLED = 1  # V4L2_CTRL_FLAG_DISABLED
_HANDED_ON = 0.98  # of a rate that is asked for: 29.97 Hz is 30 Hz


def _request(number: int, layout: str, *, reads: bool) -> int:
    """Return the number of an ioctl that takes and returns, or only returns, such a structure."""
    return (2 if reads else 3) << 30 | struct.calcsize(layout) << 16 | ord("V") << 8 | number


_CAPABILITY = "=16s32s32s3I3I"
_FORMAT = "=3I32s2I3I"
_SIZE = "=3I6I2I"
_INTERVAL = "=5I6I2I"
_CONTROL = "=2I32s4iI2I"
REQUESTS = {
    "VIDIOC_QUERYCAP": _request(0, _CAPABILITY, reads=True),
    "VIDIOC_ENUM_FMT": _request(2, _FORMAT, reads=False),
    "VIDIOC_ENUM_FRAMESIZES": _request(74, _SIZE, reads=False),
    "VIDIOC_ENUM_FRAMEINTERVALS": _request(75, _INTERVAL, reads=False),
    "VIDIOC_QUERYCTRL": _request(36, _CONTROL, reads=False),
}


class PixelFormat(StrEnum):
    """Formats that are recorded, preferred ones first; the camera's own JPEG stays untouched."""

    MJPG = "MJPG"
    YUYV = "YUYV"
    NV12 = "NV12"
    GREY = "GREY"

    @property
    def code(self) -> int:
        """Its number in V4L2 and OpenCV."""
        return int.from_bytes(self.value.encode(), "little")


CONTROLS = {
    "exposure": 0x009A0902,
    "gain": 0x00980913,
    "white_balance": 0x0098091A,
    "leds": 0x009A090D,  # a DIGIT takes its lamps' brightness as the zoom
}
"""Number in V4L2 of each control that is set, by its name in ``[camera]``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoMode:
    """One format and size that a camera offers, with its rates [Hz], the highest first."""

    pixel_format: str
    width: int
    height: int
    rates_hz: tuple[float, ...]

    def __str__(self) -> str:
        rates = " or ".join(f"{rate:g}" for rate in self.rates_hz) or "unlisted"
        return f"{self.pixel_format} {self.width}x{self.height} at {rates} fps"

    def rate_for(self, asked_hz: float) -> float:
        """Return the lowest offered rate that delivers what is asked [Hz], or the highest."""
        enough = [rate for rate in self.rates_hz if rate >= _HANDED_ON * asked_hz]
        return min(enough) if enough else max(self.rates_hz, default=asked_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """What a camera says of itself."""

    driver: str  # the kernel's driver; ``uvcvideo`` for USB cameras
    card: str  # name of the camera
    modes: tuple[VideoMode, ...]
    # Least value, largest value and step of each control that it has.
    ranges: dict[str, tuple[int, int, int]]


def read_offer(path: str) -> Offer:
    """Ask a camera what it offers; nothing of it is changed.

    Raises:
        DeviceError: It cannot be opened or is no camera.
    """
    try:
        file = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    except OSError as error:
        raise DeviceError(
            f"camera: {path} does not open ({error.strerror})",
            remedy="unplug it and plug it in again; `v4l2-ctl --list-devices` lists cameras",
        ) from error
    try:
        answer = _ask(file, "VIDIOC_QUERYCAP", _CAPABILITY, (b"", b"", b"", *[0] * 6))
        return Offer(
            driver=_text(answer[0]),
            card=_text(answer[1]),
            modes=tuple(_modes(file)),
            ranges=dict(_ranges(file)),
        )
    except OSError as error:
        raise DeviceError(
            f"camera: {path} answers no question of V4L2 ({error.strerror})",
            remedy="camera.device must name a camera: `v4l2-ctl --list-devices` lists them",
        ) from error
    finally:
        os.close(file)


def modes_for(offer: Offer, *, width: int, height: int, rate_hz: float) -> list[VideoMode]:
    """Return what to ask of a camera, best first: fast enough, then in ``PixelFormat``'s order.

    Raises:
        DeviceError: It offers no such size in a format that is recorded.
    """
    preferred = list(PixelFormat)
    fitting = [
        mode
        for mode in offer.modes
        if (mode.width, mode.height) == (width, height) and mode.pixel_format in preferred
    ]
    if not fitting:
        listed = "; ".join(map(str, offer.modes)) or "nothing"
        raise DeviceError(
            f"camera: {offer.card} offers no {width}x{height} px as {', '.join(preferred)}; it "
            f"offers {listed}",
            remedy="set camera.width and camera.height to a size that it offers",
        )

    def worth(mode: VideoMode) -> tuple[bool, int]:
        is_slow = mode.rate_for(rate_hz) < _HANDED_ON * rate_hz
        return is_slow, preferred.index(PixelFormat(mode.pixel_format))

    return sorted(fitting, key=worth)


def _modes(file: int) -> Iterator[VideoMode]:
    for _, _, _, _, code, *_ in _listed(file, "VIDIOC_ENUM_FMT", _FORMAT, (_CAPTURE, 0, b"", 0)):
        name = code.to_bytes(4, "little").decode("ascii", "replace")
        for _, _, kind, *numbers in _listed(file, "VIDIOC_ENUM_FRAMESIZES", _SIZE, (code,)):
            # A range of sizes gives its smallest and its largest.
            largest = numbers[:2] if kind == _DISCRETE else [numbers[1], numbers[4]]
            smallest = [numbers[0], numbers[3]] if kind != _DISCRETE else largest
            for width, height in sorted({tuple(largest), tuple(smallest)}, reverse=True):
                rates = tuple(sorted(_rates(file, code, width, height), reverse=True))
                yield VideoMode(pixel_format=name, width=width, height=height, rates_hz=rates)


def _rates(file: int, code: int, width: int, height: int) -> Iterator[float]:
    asked = (code, width, height)
    for _, _, _, _, kind, *numbers in _listed(file, "VIDIOC_ENUM_FRAMEINTERVALS", _INTERVAL, asked):
        # A range of intervals gives its shortest and its longest.
        intervals = [numbers[:2]] if kind == _DISCRETE else [numbers[:2], numbers[2:4]]
        yield from (below / above for above, below in intervals if above)
        if kind != _DISCRETE:
            return


def _ranges(file: int) -> Iterator[tuple[str, tuple[int, int, int]]]:
    for name, code in CONTROLS.items():
        try:
            answer = _ask(file, "VIDIOC_QUERYCTRL", _CONTROL, (code, 0, b"", *[0] * 7))
        except OSError:
            continue  # it has no such control
        if not answer[7] & _DISABLED:
            yield name, (answer[3], answer[4], max(answer[5], 1))


def _listed(
    file: int, request: str, layout: str, asked: Sequence[Any]
) -> Iterator[tuple[Any, ...]]:
    """Yield the entries of a list until the kernel says that there are no more."""
    count = len(struct.unpack(layout, bytes(struct.calcsize(layout))))
    for index in range(256):
        try:
            yield _ask(file, request, layout, (index, *asked, *[0] * (count - 1 - len(asked))))
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return
            raise


def _ask(file: int, request: str, layout: str, values: Sequence[Any]) -> tuple[Any, ...]:
    packed = struct.pack(layout, *values)
    return struct.unpack(layout, fcntl.ioctl(file, REQUESTS[request], packed))


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("utf-8", "replace")
