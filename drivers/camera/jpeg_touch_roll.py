"""What a JPEG shows cheaply: that it is whole, its size, whether it is overexposed, a touch."""

from collections import deque

import cv2
import numpy as np
import numpy.typing as npt

from drivers.camera.v4l2_modes import PixelFormat
from drivers.interfaces import TouchMode
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.image_codec import decode_grey, reduction_to

CLIPPED_LEVEL = 250

_START = b"\xff\xd8"
_END = b"\xff\xd9"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN = 0xDA


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) in pixels of a JPEG that has a start, a frame header and an end.

    Zero bytes after the end are allowed, because cameras pad. Damage inside the compressed
    data goes unnoticed here.

    Returns:
        None where the bytes are no whole JPEG.
    """
    if not data.startswith(_START) or not data.rstrip(b"\0").endswith(_END):
        return None
    position = len(_START)
    while position + 9 < len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xFF:  # fill byte
            position += 1
            continue
        if marker == _START_OF_SCAN:
            return None
        if marker in _FRAME_HEADERS:
            height = int.from_bytes(data[position + 5 : position + 7], "big")
            width = int.from_bytes(data[position + 7 : position + 9], "big")
            return width, height
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    return None


def clipped_ratio(jpeg: bytes) -> float | None:
    """Return the share of pixels at full scale, judged at an eighth of the size.

    Returns:
        None where the bytes cannot be decoded.
    """
    grey = decode_grey(jpeg, reduction=8)
    return None if grey is None else float(np.mean(grey >= CLIPPED_LEVEL))


_BLUR_PX = 3
_MIDDLE = 0.25  # of width and height is left out at each border
_DEVIATIONS = 8.0
_LEAST_LEVELS = 2.0  # of 255: what JPEG's rounding may change
_LEAST_PX = 4  # of the reduced picture: 16 x 16 px of the frame
_MOST_REFERENCES = 60
_LEAST_WIDTH_PX = 40


class TouchWatch:
    """Remembers pictures without contact, and compares later ones with them.

    Judged at down to an eighth of the size, in grey, in the middle half of the picture, where the
    indenter comes down. A change of light as a whole is no touch, and a light touch stays unseen.
    """

    def __init__(self) -> None:
        self._mode = TouchMode.NOTHING
        self._references: list[npt.NDArray[np.float32]] = []
        self._mean: npt.NDArray[np.float32] | None = None
        self._allowed = 0.0

    def ask(self, mode: TouchMode) -> None:
        """Look for what ``mode`` says from now on."""
        if mode is TouchMode.REFERENCE:
            self._references.clear()
            self._mean = None
        elif mode is TouchMode.TOUCH and len(self._references) > 1:
            stack = np.stack(self._references)
            self._mean = stack.mean(axis=0)
            self._allowed = max(_LEAST_LEVELS, _DEVIATIONS * float(np.std(stack - self._mean)))
        self._mode = mode

    def see(self, jpeg: bytes) -> bool:
        """Take a frame; return whether it shows a touch. False where that is not asked."""
        if self._mode is TouchMode.NOTHING:
            return False
        small = _small(jpeg)
        if small is None:
            return False
        if self._mode is TouchMode.REFERENCE:
            self._references = [*self._references[-_MOST_REFERENCES:], small]
            return False
        if self._mean is None or self._mean.shape != small.shape:
            return False
        change = small - self._mean
        change -= np.median(change)
        return int(np.count_nonzero(np.abs(change) > self._allowed)) >= _LEAST_PX


def _small(jpeg: bytes) -> npt.NDArray[np.float32] | None:
    size = jpeg_size(jpeg)
    if size is None:
        return None
    grey = decode_grey(jpeg, reduction=reduction_to(size[0] / _LEAST_WIDTH_PX))
    if grey is None:
        return None
    top, left = (round(_MIDDLE * side) for side in grey.shape)
    middle = grey[top : grey.shape[0] - top, left : grey.shape[1] - left]
    return np.asarray(cv2.blur(middle.astype(np.float32), (_BLUR_PX, _BLUR_PX)))


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
    return raw.reshape(-1)[:3].tobytes() == _START + b"\xff"


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
