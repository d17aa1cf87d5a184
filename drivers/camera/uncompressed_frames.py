"""Uncompressed frames: encoded as JPEG, and those found that USB's losses have rolled sideways."""

from collections import deque

import cv2
import numpy as np
import numpy.typing as npt

from drivers.camera.v4l2_modes import PixelFormat
from tacauchy_rig.core.arrays import ImageArray

_QUALITY = 96
_ENCODING = (
    *(cv2.IMWRITE_JPEG_QUALITY, _QUALITY),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422),
)
RECORDED_AS = f"JPEG of quality {_QUALITY}"
_TO_COLOUR = {PixelFormat.YUYV: cv2.COLOR_YUV2BGR_YUYV, PixelFormat.NV12: cv2.COLOR_YUV2BGR_NV12}
_TO_GREY = {PixelFormat.YUYV: cv2.COLOR_YUV2GRAY_YUYV, PixelFormat.NV12: cv2.COLOR_YUV2GRAY_NV12}


def frame_shape(pixel_format: PixelFormat, width: int, height: int) -> tuple[int, ...]:
    """Return the shape of the bytes of a whole uncompressed frame, as OpenCV hands them over."""
    if pixel_format is PixelFormat.YUYV:
        return height, width, 2
    return (height * 3 // 2, width) if pixel_format is PixelFormat.NV12 else (height, width)


def is_jpeg(raw: ImageArray) -> bool:
    """Return whether bytes that should be pixels begin as a JPEG does."""
    return raw.reshape(-1)[:3].tobytes() == b"\xff\xd8\xff"


def encoded(raw: ImageArray, pixel_format: PixelFormat) -> bytes:
    """Return a frame as JPEG; colours as OpenCV converts them (ITU-R BT.601, video range)."""
    image = raw
    if pixel_format in _TO_COLOUR:
        image = np.asarray(cv2.cvtColor(raw, _TO_COLOUR[pixel_format]), np.uint8)
    return bytes(cv2.imencode(".jpg", image, _ENCODING)[1])


_BANDS, _COLUMNS = 24, 160
_LEAST_SHIFT = 2  # of the columns above
_LEAST_CHANGE = 1.0  # grey levels, over the mean of some 80 pixels; less is noise
_EXPLAINED = 0.5  # of the change, by a shift, makes it a roll
_FIRST_FRAMES = 5


class RollWatch:
    """Finds frames that are rolled sideways, wholly or from some row on.

    Bytes that USB loses in an uncompressed frame move the rest of it towards the left, and no
    checksum tells. Each of 24 bands of rows is compared with the same band of a reference, as it is
    and rolled by any number of columns. The reference is the frame that most of the first five
    agree with, so frames that are all rolled alike from the first on are not found.
    """

    def __init__(self) -> None:
        self._first: deque[npt.NDArray[np.float32]] = deque(maxlen=_FIRST_FRAMES)
        self._reference: npt.NDArray[np.float32] | None = None

    def is_rolled(self, raw: ImageArray, pixel_format: PixelFormat) -> bool:
        """Take a frame; return whether it is rolled against the reference."""
        grey = raw
        if pixel_format in _TO_GREY:
            grey = np.asarray(cv2.cvtColor(raw, _TO_GREY[pixel_format]), np.uint8)
        small = cv2.resize(grey, (_COLUMNS, _BANDS), interpolation=cv2.INTER_AREA)
        bands = np.asarray(small, np.float32)
        if len(self._first) < _FIRST_FRAMES:
            self._first.append(bands)
            rolls = [sum(_rolled(other, each) for other in self._first) for each in self._first]
            self._reference = self._first[int(np.argmin(rolls))]
        return self._reference is not None and _rolled(bands, self._reference)


def _rolled(bands: npt.NDArray[np.float32], reference: npt.NDArray[np.float32]) -> bool:
    """Return whether a roll explains a band [bands, columns] much better than none does."""
    # Mean square of band(x) - reference(x + shift), for each shift, by the correlation theorem.
    product = np.conj(np.fft.rfft(bands)) * np.fft.rfft(reference)
    correlation = np.fft.irfft(product, _COLUMNS) / _COLUMNS
    power = np.mean(bands**2, axis=1) + np.mean(reference**2, axis=1)
    change = np.sqrt(np.maximum(power[:, None] - 2.0 * correlation, 0.0))
    best = change[:, _LEAST_SHIFT : _COLUMNS - _LEAST_SHIFT + 1].min(axis=1)
    as_it_is = change[:, 0]
    return bool(np.any((as_it_is > _LEAST_CHANGE) & (best < _EXPLAINED * as_it_is)))
