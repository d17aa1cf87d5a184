"""What a frame shows: a whole JPEG, its size, overexposure, and whether the gel is touched."""

import cv2
import numpy as np
import numpy.typing as npt

from drivers.interfaces import TouchMode
from tacauchy_rig.core.image_codec import decode_grey, reduction_to, stated_size

CLIPPED_LEVEL = 250

_START = b"\xff\xd8"
_END = b"\xff\xd9"


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) in pixels of a JPEG that has a start, a frame header and an end.

    Zero bytes after the end are allowed, because cameras pad. Damage inside the compressed
    data goes unnoticed here.

    Returns:
        None where the bytes are no whole JPEG.
    """
    if not data.startswith(_START) or not data.rstrip(b"\0").endswith(_END):
        return None
    return stated_size(data)


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
