"""How much the contact in the pictures of a dwell changes within it, as a share of itself.

The pose is held, so it may not: a camera that delivers new frames of an older pose shows it here,
where bytes, stamps and counters are all new.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, ImageArray

THIRDS = 3
ROUNDING_LEVELS = 1.0 / math.sqrt(12.0)
"""Of one frame to 8 bits: a contact that changes less than that does not show."""


def settled_change(pressed: Sequence[ImageArray], reference: ImageArray) -> float | None:
    """Return by how much of the contact first and last third of a dwell differ [1].

    Their difference is projected on the contact's own image, the mean of the dwell less the
    reference. Noise has no part in that image but by chance: of N values with a deviation s beside
    a contact c it leaves s / (c sqrt(N)), whether or not a camera repeats its noise.

    Args:
        pressed: Frames of the dwell in order, shape [height, width, 3] each.
        reference: The gel without contact.

    Returns:
        0 for pictures that show one contact; None for fewer than three frames.
    """
    count = len(pressed) // THIRDS
    if count == 0:
        return None
    contact = _mean(pressed) - reference
    change = _mean(pressed[-count:]) - _mean(pressed[:count])
    strength = max(float(np.mean(contact**2)), ROUNDING_LEVELS**2)
    return abs(float(np.mean(change * contact))) / strength


def _mean(images: Sequence[ImageArray]) -> FloatArray:
    return np.asarray(np.mean(np.stack(images), axis=0, dtype=np.float64))
