"""A twin's images and maps as the bytes of a picture."""

from __future__ import annotations

import cv2
import numpy as np

from tacauchy_rig.core.arrays import FloatArray, ImageArray

_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 85]


def jpeg_of(image: ImageArray) -> bytes:
    """Return an RGB image as JPEG."""
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _QUALITY)[1])


def map_picture(values: FloatArray, *, highest: float) -> bytes:
    """Return a map as JPEG: black is nothing, light yellow ``highest``, both in its own unit."""
    share = np.clip(values / max(highest, 1e-300), 0.0, 1.0)
    drawn = cv2.applyColorMap(np.rint(255.0 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)
    return bytes(cv2.imencode(".jpg", drawn, _QUALITY)[1])
