"""Images in and out of files, and as grey."""

from __future__ import annotations

import numpy as np

from tacauchy_rig.core.rgb import decode_rgb, encode_png, to_grey


def test_a_png_comes_back() -> None:
    """Every pixel and the order of the channels survive; what is no image is None."""
    image = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    again = decode_rgb(encode_png(image))
    assert again is not None
    assert np.array_equal(again, image)
    assert decode_rgb(b"") is None
    assert decode_rgb(b"no image") is None


def test_grey_is_bt601() -> None:
    """Luminance weights are 0.299, 0.587, 0.114; grey stays as it is."""
    pixel = np.array([[[200, 100, 50]]], np.uint8)
    assert to_grey(pixel)[0, 0] == round(0.299 * 200 + 0.587 * 100 + 0.114 * 50)
    assert np.array_equal(to_grey(pixel[..., 0]), pixel[..., 0])
