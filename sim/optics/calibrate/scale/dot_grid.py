"""Centres of the dots of a regular grid, to a small part of a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray

_SMOOTHING_PX = 1.0
_SMALLEST_AREA_PX = 6.0
_SMALLEST_AREA = 0.3  # of the median blob's
_FULL_QUANTILE = 0.995  # of the contrast: that of a dot's middle
_BLOB_SHARE = 0.4  # of that contrast, at which a dot ends
_FLOOR_SHARE = 0.1  # of a dot's highest contrast that does not weigh
_NEIGHBOUR = 1.3  # times the nearest distance, below the 1.41 of diagonals
_LATTICE_TOLERANCE = 0.25


def find_dots(image: NDArray[np.uint8], *, columns: int, rows: int) -> FloatArray | None:
    """Find a grid of dark or bright dots that lies within 45 degrees of the image's axes.

    Args:
        image: Grey, shape [height, width].
        columns: Dots along the grid's rows.
        rows: Rows of dots.

    Returns:
        Column, row of the dots' centres [px], row by row, shape [columns * rows, 2]; None where
        no such grid is seen.
    """
    for polarity in (1.0, -1.0):
        centres = _blobs(polarity * (_background(image) - image))
        ordered = _as_grid(centres, columns, rows)
        if ordered is not None:
            return ordered
    return None


def _background(image: NDArray[np.uint8]) -> FloatArray:
    size = 2 * (max(image.shape) // 10) + 1
    return np.asarray(cv2.medianBlur(image, min(size, 255)), dtype=np.float64)


def _blobs(contrast: FloatArray) -> FloatArray:
    """Return the intensity-weighted centres of what stands out, shape [n, 2]."""
    smooth = np.asarray(cv2.GaussianBlur(contrast, (0, 0), _SMOOTHING_PX), dtype=np.float64)
    level = np.quantile(smooth, _FULL_QUANTILE)
    if level <= 0.0:
        return np.empty((0, 2))
    mask = (smooth > _BLOB_SHARE * level).astype(np.uint8)
    stats = cv2.connectedComponentsWithStats(mask)[2]
    areas = stats[1:, cv2.CC_STAT_AREA]
    kept = 1 + np.flatnonzero(
        areas >= max(_SMALLEST_AREA_PX, _SMALLEST_AREA * float(np.median(areas)))
    )
    return np.array(
        [_centre(smooth, [int(value) for value in stats[k, :4]]) for k in kept]
    ).reshape(-1, 2)


def _centre(contrast: FloatArray, box: list[int]) -> FloatArray:
    """Weigh the pixels in and somewhat around a blob's box with their contrast above a tenth."""
    left, top, width, height = box
    margin = max(width, height) // 3 + 1
    rows = slice(max(0, top - margin), top + height + margin)
    columns = slice(max(0, left - margin), left + width + margin)
    part = contrast[rows, columns]
    weight = np.maximum(part - _FLOOR_SHARE * part.max(), 0.0)
    j, i = np.mgrid[: part.shape[0], : part.shape[1]]
    total = weight.sum()
    return np.array(
        [columns.start + (weight * i).sum() / total, rows.start + (weight * j).sum() / total]
    )


def _as_grid(centres: FloatArray, columns: int, rows: int) -> FloatArray | None:
    """Order centres row by row; None unless they are exactly a grid of that size."""
    if len(centres) < columns * rows or len(centres) < 4:
        return None
    steps = _steps(centres)
    if steps is None:
        return None
    place = (centres - np.median(centres, axis=0)) @ np.linalg.inv(steps)
    place = place - place[np.argmin(np.abs(place).sum(axis=1))]
    whole = np.rint(place).astype(np.int64)
    regular = np.abs(place - whole).max(axis=1) < _LATTICE_TOLERANCE
    whole, centres = whole[regular], centres[regular]
    if len(centres) != columns * rows:
        return None
    whole = whole - whole.min(axis=0)
    index = whole[:, 1] * columns + whole[:, 0]
    if (whole.max(axis=0) != (columns - 1, rows - 1)).any() or len(set(index.tolist())) != len(
        index
    ):
        return None
    return np.asarray(centres[np.argsort(index)])


def _steps(centres: FloatArray) -> FloatArray | None:
    """Return the grid's steps along its rows and columns [px], rows of a [2, 2] array."""
    offsets = centres[None] - centres[:, None]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    np.fill_diagonal(distance, np.inf)
    nearest = float(np.median(distance.min(axis=1)))
    near = offsets[distance < _NEIGHBOUR * nearest]
    along = near[(near[:, 0] > 0.0) & (np.abs(near[:, 1]) <= near[:, 0])]
    down = near[(near[:, 1] > 0.0) & (np.abs(near[:, 0]) < near[:, 1])]
    if len(along) == 0 or len(down) == 0:
        return None
    steps = np.array([np.median(along, axis=0), np.median(down, axis=0)])
    return steps if abs(float(np.linalg.det(steps))) > 1.0 else None
