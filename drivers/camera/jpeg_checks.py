"""What a JPEG shows cheaply: that it is whole, its size, whether it is overexposed."""

import numpy as np

from tacauchy_rig.core.image_codec import decode_grey

CLIPPED_LEVEL = 250

_START = b"\xff\xd8"
_END = b"\xff\xd9"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN = 0xDA


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) in pixels of a JPEG that has a start, a frame header and an end.

    Zero bytes after the end are allowed, because cameras pad. Damage inside the compressed
    data goes unnoticed here.

    Returns:
        None where the bytes are no whole JPEG.
    """
    if not data.startswith(_START) or not data.rstrip(b"\0").endswith(_END):
        return None
    position = len(_START)
    while position + 9 < len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xFF:  # fill byte
            position += 1
            continue
        if marker == _START_OF_SCAN:
            return None
        if marker in _FRAME_HEADERS:
            height = int.from_bytes(data[position + 5 : position + 7], "big")
            width = int.from_bytes(data[position + 7 : position + 9], "big")
            return width, height
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    return None


def clipped_ratio(jpeg: bytes) -> float | None:
    """Return the share of pixels at full scale, judged at an eighth of the size.

    Returns:
        None where the bytes cannot be decoded.
    """
    grey = decode_grey(jpeg, reduction=8)
    return None if grey is None else float(np.mean(grey >= CLIPPED_LEVEL))
