"""Images as RGB, uint8, shape [height, width, 3]: from and to the bytes of a file, and as grey."""

from __future__ import annotations

from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray


class ColourOrder(StrEnum):
    """Of an image's channels as a file has them."""

    RGB = "RGB"
    BGR = "BGR"


def decode_rgb(data: bytes) -> NDArray[np.uint8] | None:
    """Return the image that a JPEG or PNG holds; None when it is no whole image."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    return None if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """Return an RGB image as PNG."""
    return bytes(cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1])


def encode_jpeg(image: NDArray[np.uint8], *, quality: int) -> bytes:
    """Return an RGB image as JPEG of a quality from 0 to 100."""
    setting = [cv2.IMWRITE_JPEG_QUALITY, quality]
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), setting)[1])


def to_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the luminance (ITU-R BT.601 weights), shape [height, width]; grey stays as it is."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
