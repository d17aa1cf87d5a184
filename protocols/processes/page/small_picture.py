"""The camera's picture for the page: small enough for a browser."""

from functools import lru_cache

from drivers.camera.frame_checks import jpeg_size
from tacauchy_rig.core.image_codec import decode_rgb, encode_jpeg

WIDEST_PX = 1000


@lru_cache(maxsize=16)
def reduced(picture: bytes) -> bytes:
    """Return a JPEG wider than ``WIDEST_PX`` at a half, a quarter or an eighth of its size.

    Others are returned as they are, and so is what cannot be decoded.
    """
    size = jpeg_size(picture)
    if size is None or size[0] <= WIDEST_PX:
        return picture
    reduction = next((by for by in (2, 4) if size[0] <= by * WIDEST_PX), 8)
    colours = decode_rgb(picture, reduction=reduction)
    return picture if colours is None else encode_jpeg(colours)
