"""How much the pictures of a dwell change within it, as a share of what the contact changes.

The pose is held, so they may not: a camera that delivers new frames of an older pose shows it here,
where bytes, stamps and counters are all new.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from reports.arrays import ColorImage, FloatArray

THIRDS = 3
ROUNDING_LEVELS = 1.0 / math.sqrt(12.0)
"""Of one frame to 8 bits: no contact signal is known better than that."""


def settled_change(pressed: Sequence[ColorImage], reference: ColorImage) -> float | None:
    """Return the change between first and last third of a dwell over that made by the contact [1].

    What noise from frame to frame explains is taken off: of the difference of two means of n frames
    it leaves the variance of one frame times 2 / n.

    Args:
        pressed: Frames of the dwell in order, shape [height, width, 3] each.
        reference: The gel without contact.

    Returns:
        0 for pictures that do not change beyond noise; None for fewer than three frames.
    """
    count = len(pressed) // THIRDS
    if count == 0:
        return None
    first, last = _mean(pressed[:count]), _mean(pressed[-count:])
    steps = [
        np.mean(np.subtract(after, before, dtype=np.float64) ** 2)
        for before, after in pairwise(pressed)
    ]
    # The median of all steps: one leap, which is what is looked for, is no noise.
    noise = float(np.median(steps)) / 2.0 * (2.0 / count)
    change = max(float(np.mean((last - first) ** 2)) - noise, 0.0)
    contact = float(np.mean((last - reference) ** 2))
    return math.sqrt(change / max(contact, ROUNDING_LEVELS**2))


def _mean(images: Sequence[ColorImage]) -> FloatArray:
    return np.asarray(np.mean(np.stack(images), axis=0, dtype=np.float64))
