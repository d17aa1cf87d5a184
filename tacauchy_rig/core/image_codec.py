"""Images as RGB or grey, uint8: the one decoder and encoder of JPEG and PNG."""

import base64
import math
import struct
from enum import StrEnum

import cv2
import numpy as np

from tacauchy_rig.core.arrays import ImageArray

# By how much a decoder reduces a picture: a quarter of the time for a half of its size.
_COLOUR = {
    8: cv2.IMREAD_REDUCED_COLOR_8,
    4: cv2.IMREAD_REDUCED_COLOR_4,
    2: cv2.IMREAD_REDUCED_COLOR_2,
    1: cv2.IMREAD_COLOR,
}


_PNG = b"\x89PNG"
_MAX_PIXELS = 64 << 20
"""Far above any camera here; a file of some kilobytes can claim a hundred times as many."""
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that begin the size of a JPEG."""
_MARKER, _START_OF_SCAN = 0xFF, 0xDA


class ColourOrder(StrEnum):
    """Of an image's channels as a file has them."""

    RGB = "RGB"
    BGR = "BGR"


def reduction_to(share: float) -> int:
    """Return the largest reduction (8, 4, 2 or 1) that leaves at least 1 / ``share`` of a size."""
    return next((by for by in _COLOUR if by <= share), 1)


def decode_rgb(data: bytes, *, reduction: int = 1) -> ImageArray | None:
    """Return the image that a JPEG or PNG holds; None when it is no whole image.

    Args:
        reduction: Decode at 1/2, 1/4 or 1/8 of the size, which takes less time.
    """
    image = _decoded(data, _COLOUR[reduction])
    return None if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def decode_grey(data: bytes, *, reduction: int = 1) -> ImageArray | None:
    """Return the luminance of a JPEG or PNG, [height, width]; arguments as for ``decode_rgb``."""
    return _decoded(data, _COLOUR[reduction] & ~cv2.IMREAD_COLOR)


def stated_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height that a JPEG or PNG states [px]; None where it states none."""
    if data.startswith(_PNG):
        width, height = struct.unpack(">II", data[16:24].ljust(8, b"\0"))
        return width, height
    place = 2
    while place + 9 <= len(data) and data[place] == _MARKER:
        _, kind, length, _, height, width = struct.unpack_from(">BBHBHH", data, place)
        if kind in _JPEG_FRAMES:
            return width, height
        if kind == _START_OF_SCAN:
            return None
        place += 1 if kind == _MARKER else 2 + max(length, 1)  # one more fills
    return None


def _decoded(data: bytes, flag: int) -> ImageArray | None:
    if not data or math.prod(stated_size(data) or (0,)) > _MAX_PIXELS:
        return None
    try:
        found = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    except cv2.error:
        return None
    return None if found is None else np.asarray(found, np.uint8)


def media_type(picture: bytes) -> str:
    """Return what kind of picture it is, JPEG or PNG."""
    return "image/png" if picture.startswith(_PNG) else "image/jpeg"


def data_url(picture: bytes) -> str:
    """Return a JPEG or PNG as what a page shows without a link."""
    return f"data:{media_type(picture)};base64,{base64.b64encode(picture).decode()}"


def encode_png(image: ImageArray) -> bytes:
    """Return an RGB image as PNG."""
    return bytes(cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1])


def encode_jpeg(image: ImageArray, *, quality: int = 95) -> bytes:
    """Return an RGB image as JPEG of a quality from 0 to 100."""
    setting = [cv2.IMWRITE_JPEG_QUALITY, quality]
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), setting)[1])


def to_grey(image: ImageArray) -> ImageArray:
    """Return the luminance (ITU-R BT.601 weights), shape [height, width]; grey stays as it is."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
