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
        pool = np.empty(shape, np.int8)
        for row in range(0, shape[0], _MARGIN_PX):  # in parts: the floats need four times the room
            part = self._random.standard_normal(
                (min(_MARGIN_PX, shape[0] - row), *shape[1:]), np.float32
            )
            pool[row : row + _MARGIN_PX] = np.round(part * truth.image_noise_levels)
        self._pool = pool

    def added(self, block: ImageArray) -> ImageArray:
        """Return ``block`` [rows, columns, 3] with noise."""
        rows, columns = block.shape[:2]
        top = int(self._random.integers(0, self._pool.shape[0] - rows + 1))
        left = int(self._random.integers(0, self._pool.shape[1] - columns + 1))
        noise = self._pool[top : top + rows, left : left + columns]
        return np.asarray(cv2.add(block, noise, dtype=cv2.CV_8U), np.uint8)
