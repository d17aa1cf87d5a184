"""Array types of this package and the checks that every image passes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.errors import RecordError

ColorImage = NDArray[np.uint8]
"""RGB image, shape [height, width, 3]."""

GreyImage = NDArray[np.uint8]
"""Luminance image, shape [height, width]."""

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
"""Pixels of a region, shape [height, width]."""


def check_image_pair(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> None:
    """Check that two 8-bit images, grey or RGB, can be compared pixel by pixel.

    Raises:
        RecordError: Other type, other shape, or not an image.
    """
    for image in (first, second):
        is_image = image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)
        if image.dtype != np.uint8 or not is_image:
            raise RecordError(
                f"image of type {image.dtype} and shape {image.shape} cannot be scored",
                remedy="give 8-bit images of shape [height, width] or [height, width, 3]",
            )
    if first.shape != second.shape:
        raise RecordError(
            f"images of shape {first.shape} and {second.shape} cannot be compared",
            remedy="crop and resize both to the same size first",
        )
