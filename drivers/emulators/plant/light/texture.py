"""The paint's texture: blotches, grain and a few smudges, fixed on the gel."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.emulators.plant.arrays import SingleArray
from drivers.emulators.plant.light.view import View

# Cells across the frame (columns, rows) and strength of each layer of noise.
_LAYERS = (((8, 6), 0.010), ((48, 36), 0.004), ((456, 342), 0.004))
_SMUDGE_COUNT = 14


def gel_texture(view: View, *, seed: int) -> SingleArray:
    """Return the paint's reflectance around one, shape [height, width]; the same at any size."""
    random = np.random.default_rng([seed, 2])
    texture = np.ones((view.height, view.width), np.float32)
    for (columns, rows), strength in _LAYERS:
        cells = random.standard_normal((rows, columns)).astype(np.float32)
        texture += strength * cv2.resize(
            cells, (view.width, view.height), interpolation=cv2.INTER_CUBIC
        )
    column = np.linspace(0.0, 1.0, view.width, dtype=np.float32)
    row = np.linspace(0.0, 1.0, view.height, dtype=np.float32)[:, None]
    for _ in range(_SMUDGE_COUNT):
        centre_x, centre_y = random.uniform(0.05, 0.95, 2)
        size_x, size_y = random.uniform(0.003, 0.010, 2)
        strength = random.uniform(0.01, 0.035)
        spot = ((column - centre_x) / size_x) ** 2 + ((row - centre_y) / (size_y * 4 / 3)) ** 2
        texture -= np.float32(strength) * np.exp(-0.5 * spot, dtype=np.float32)
    return texture
