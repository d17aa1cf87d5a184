"""Pictures as a page needs them: no larger than a screen shows."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from drivers.camera.jpeg import jpeg_size

WIDEST_PX = 1000
_PNG = b"\x89PNG"
_REDUCED = (
    (8, cv2.IMREAD_REDUCED_COLOR_8),
    (4, cv2.IMREAD_REDUCED_COLOR_4),
    (2, cv2.IMREAD_REDUCED_COLOR_2),
)


def media_type(picture: bytes) -> str:
    """Return what kind of picture it is."""
    return "image/png" if picture.startswith(_PNG) else "image/jpeg"


@lru_cache(maxsize=16)
def reduced(picture: bytes) -> bytes:
    """Return a JPEG wider than ``WIDEST_PX`` at a half, a quarter or an eighth of its size.

    Others are returned as they are, and so is what cannot be decoded.
    """
    size = jpeg_size(picture)
    if size is None or size[0] <= WIDEST_PX:
        return picture
    fitting = [flag for by, flag in reversed(_REDUCED) if size[0] <= by * WIDEST_PX]
    colours = cv2.imdecode(np.frombuffer(picture, np.uint8), (fitting or [_REDUCED[0][1]])[0])
    if colours is None:
        return picture
    return bytes(cv2.imencode(".jpg", colours)[1].tobytes())
