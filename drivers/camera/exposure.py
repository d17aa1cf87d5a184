"""How much of an image is too bright to show anything."""

from __future__ import annotations

import cv2
import numpy as np

CLIPPED_LEVEL = 250


def clipped_ratio(jpeg: bytes) -> float | None:
    """Return the share of pixels at full scale, judged at an eighth of the size.

    Returns:
        None where the bytes cannot be decoded.
    """
    grey = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8)
    return None if grey is None else float(np.mean(grey >= CLIPPED_LEVEL))
