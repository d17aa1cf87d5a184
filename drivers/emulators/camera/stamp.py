"""A frame's number, drawn as 8x8-pixel blocks into the top border of the frame itself.

It survives JPEG, gives exact gaps and latency, and lies in the border that is cropped away. The
upper row of blocks holds the number's 32 bits, the lower row their complement as a check.
"""

from __future__ import annotations

import numpy as np

from drivers.emulators.plant.arrays import ImageArray

BLOCK_PX = 8
BIT_COUNT = 32
STAMP_WIDTH_PX = BLOCK_PX * BIT_COUNT
STAMP_HEIGHT_PX = 2 * BLOCK_PX
_DARK, _BRIGHT = 16, 240


def draw_number(image: ImageArray, number: int) -> None:
    """Draw ``number`` into the top left corner of ``image`` [rows, columns, 3], in place."""
    bits = (number >> np.arange(BIT_COUNT)) & 1
    levels = np.where(np.stack([bits, 1 - bits]), _BRIGHT, _DARK).astype(np.uint8)
    blocks = levels.repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)
    image[:STAMP_HEIGHT_PX, :STAMP_WIDTH_PX] = blocks[:, :, None]


def read_number(image: ImageArray) -> int | None:
    """Return the number drawn in ``image`` (grey or colour); None where it cannot be read."""
    corner = image[:STAMP_HEIGHT_PX, :STAMP_WIDTH_PX]
    if corner.shape[:2] != (STAMP_HEIGHT_PX, STAMP_WIDTH_PX):
        return None
    grey = corner.reshape(STAMP_HEIGHT_PX, STAMP_WIDTH_PX, -1).mean(axis=-1)
    blocks = grey.reshape(2, BLOCK_PX, BIT_COUNT, BLOCK_PX).mean(axis=(1, 3))
    bits = blocks > 0.5 * (_DARK + _BRIGHT)
    if not bool(np.all(bits[0] != bits[1])):
        return None
    return int(sum(1 << i for i in range(BIT_COUNT) if bits[0, i]))
