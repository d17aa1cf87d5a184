"""Whether a tactile camera sees its gel touched: cheaply, against pictures without contact.

Judged at down to an eighth of the size, in grey, in the middle half of the picture, where the
indenter comes down. A change of light as a whole is no touch. It is a witness, not a measurement: a
light touch stays unseen.
"""

from __future__ import annotations

from enum import StrEnum

import cv2
import numpy as np
import numpy.typing as npt

from drivers.camera.jpeg import jpeg_size

_BLUR_PX = 3
_MIDDLE = 0.25  # of width and height is left out at each border
_DEVIATIONS = 8.0
_LEAST_LEVELS = 2.0  # of 255: what JPEG's rounding may change
_LEAST_PX = 4  # of the reduced picture: 16 x 16 px of the frame
_MOST_REFERENCES = 60
_LEAST_WIDTH_PX = 40
_REDUCED = (
    (8, cv2.IMREAD_REDUCED_GRAYSCALE_8),
    (4, cv2.IMREAD_REDUCED_GRAYSCALE_4),
    (2, cv2.IMREAD_REDUCED_GRAYSCALE_2),
)


class Look(StrEnum):
    """What a camera is asked to look for."""

    NOTHING = "nothing"
    REFERENCE = "reference"
    TOUCH = "touch"


class TouchWatch:
    """Remembers pictures without contact, and compares later ones with them."""

    def __init__(self) -> None:
        self._look = Look.NOTHING
        self._references: list[npt.NDArray[np.float32]] = []
        self._mean: npt.NDArray[np.float32] | None = None
        self._allowed = 0.0

    def ask(self, look: Look) -> None:
        """Look for something else from now on."""
        if look is Look.REFERENCE:
            self._references.clear()
            self._mean = None
        elif look is Look.TOUCH and len(self._references) > 1:
            stack = np.stack(self._references)
            self._mean = stack.mean(axis=0)
            self._allowed = max(_LEAST_LEVELS, _DEVIATIONS * float(np.std(stack - self._mean)))
        self._look = look

    def see(self, jpeg: bytes) -> bool:
        """Take a frame; return whether it shows a touch. False where that is not asked."""
        if self._look is Look.NOTHING:
            return False
        small = _small(jpeg)
        if small is None:
            return False
        if self._look is Look.REFERENCE:
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
    wide = [flag for reduction, flag in _REDUCED if size[0] >= reduction * _LEAST_WIDTH_PX]
    grey = cv2.imdecode(np.frombuffer(jpeg, np.uint8), (wide or [cv2.IMREAD_GRAYSCALE])[0])
    if grey is None:
        return None
    top, left = (round(_MIDDLE * side) for side in grey.shape)
    middle = grey[top : grey.shape[0] - top, left : grey.shape[1] - left]
    return np.asarray(cv2.blur(middle.astype(np.float32), (_BLUR_PX, _BLUR_PX)))
