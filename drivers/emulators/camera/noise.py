"""Image noise, drawn once and reused at random places."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.emulators.plant.arrays import ImageArray
from drivers.emulators.plant.truth import PlantTruth

_MARGIN_PX = 64


class NoisePool:
    """Gaussian noise for frames of one size; each use begins at another place of the pool."""

    def __init__(self, truth: PlantTruth, width: int, height: int) -> None:
        self._random = np.random.default_rng([truth.seed, 4])
        shape = (height + _MARGIN_PX, width + _MARGIN_PX, 3)
        # Two pools, because OpenCV adds and subtracts bytes several times faster than it adds
        # signed numbers to them.
        self._above, self._below = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
        for row in range(0, shape[0], _MARGIN_PX):  # in parts: the floats need four times the room
            part = self._random.standard_normal(
                (min(_MARGIN_PX, shape[0] - row), *shape[1:]), np.float32
            )
            levels = np.round(part * truth.image_noise_levels)
            self._above[row : row + _MARGIN_PX] = np.maximum(levels, 0.0)
            self._below[row : row + _MARGIN_PX] = np.maximum(-levels, 0.0)

    def added(self, block: ImageArray) -> ImageArray:
        """Return ``block`` [rows, columns, 3] with noise."""
        rows, columns = block.shape[:2]
        top = int(self._random.integers(0, self._above.shape[0] - rows + 1))
        left = int(self._random.integers(0, self._above.shape[1] - columns + 1))
        window = slice(top, top + rows), slice(left, left + columns)
        brighter = cv2.add(block, self._above[window])
        return np.asarray(cv2.subtract(brighter, self._below[window]), np.uint8)
