"""What is told about a JPEG cheaply: whether it is whole, its size, and too much light."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.camera.jpeg import clipped_ratio, jpeg_size


def encoded(width: int, height: int, *flags: int) -> bytes:
    """Return a noisy JPEG."""
    image = np.random.default_rng(3).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return bytes(cv2.imencode(".jpg", image, list(flags))[1].tobytes())


@pytest.mark.parametrize(
    "flags",
    [
        (),
        (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        (cv2.IMWRITE_JPEG_OPTIMIZE, 1),
        (cv2.IMWRITE_JPEG_RST_INTERVAL, 4),
    ],
)
def test_size_of_every_kind(flags: tuple[int, ...]) -> None:
    """Baseline, progressive, optimised and restart-marked images give their size."""
    assert jpeg_size(encoded(321, 199, *flags)) == (321, 199)


def test_padding_after_the_end_is_allowed() -> None:
    """Zero bytes that a camera appends do not matter."""
    assert jpeg_size(encoded(64, 48) + bytes(100)) == (64, 48)


def test_truncated_and_headless_are_refused() -> None:
    """Images that lack their start or end are no images."""
    data = encoded(64, 48)
    assert jpeg_size(data[:-3]) is None
    assert jpeg_size(data[1:]) is None
    assert jpeg_size(b"\xff\xd8\xff\xd9") is None
    assert jpeg_size(b"") is None


@settings(deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_answered(data: bytes) -> None:
    """No input raises or loops, with or without the right ends."""
    jpeg_size(data)
    jpeg_size(b"\xff\xd8" + data + b"\xff\xd9")


def lit_from_above(white_rows: int) -> bytes:
    """Return a grey image of 240 x 320 pixels whose first rows are white."""
    image = np.full((240, 320, 3), 150, np.uint8)
    image[:white_rows] = 255
    return cv2.imencode(".jpg", image)[1].tobytes()


@pytest.mark.parametrize(("white_rows", "ratio"), [(0, 0.0), (60, 0.25), (240, 1.0)])
def test_the_share_of_white_pixels_is_found(white_rows: int, ratio: float) -> None:
    """An eighth of the size is enough to see it."""
    assert clipped_ratio(lit_from_above(white_rows)) == pytest.approx(ratio, abs=0.02)


def test_bytes_that_are_no_image_have_no_share() -> None:
    """A damaged frame says nothing about the light."""
    assert clipped_ratio(b"\xff\xd8 no image \xff\xd9") is None
