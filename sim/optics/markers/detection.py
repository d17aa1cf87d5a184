"""Dark markers of known size in a tactile image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.arrays import FloatArray

_FAINTEST = 0.25  # of what the gel around a marker reflects
_WINDOW_RADII = 1.6
_ROUNDS = 4


def dark_markers(image: NDArray[np.uint8], *, radius_px: float) -> FloatArray:
    """Find dots that are darker than the gel around them.

    Ink takes a share of the light, whatever the light: the share is what is weighed, against the
    median of a window that is wider than a marker.

    Args:
        image: Grey, shape [height, width].
        radius_px: Radius of the dots [px].

    Returns:
        Column, row of the centres [px], shape [n, 2].
    """
    window = 2 * round(2.5 * radius_px) + 1
    around = cv2.medianBlur(image, window).astype(np.float64)
    share = 1.0 - image / np.maximum(around, 1.0)
    smooth = ndimage.gaussian_filter(share, 0.5 * radius_px)
    peak = smooth == ndimage.maximum_filter(smooth, size=window)
    rows, columns = np.nonzero(peak & (smooth > _FAINTEST))
    found = [
        _centre(share, float(column), float(row), radius_px)
        for row, column in zip(rows, columns, strict=True)
    ]
    return np.array([centre for centre in found if centre is not None]).reshape(-1, 2)


def _centre(
    share: FloatArray, column: float, row: float, radius_px: float
) -> tuple[float, float] | None:
    """Move a soft round window to the centre of what it holds; None at the image's border."""
    height, width = share.shape
    reach = _WINDOW_RADII * radius_px
    for _ in range(_ROUNDS):
        if not (reach <= column <= width - 1 - reach and reach <= row <= height - 1 - reach):
            return None
        left, top = int(column - reach), int(row - reach)
        size = int(2 * reach) + 3
        part = share[top : top + size, left : left + size]
        j, i = np.mgrid[: part.shape[0], : part.shape[1]]
        distance = np.hypot(i + left - column, j + top - row)
        weight = np.maximum(part, 0.0) * np.clip(reach - distance + 0.5, 0.0, 1.0)
        total = max(float(weight.sum()), 1e-9)
        column = left + float((weight * i).sum()) / total
        row = top + float((weight * j).sum()) / total
    return column, row
