"""What is told about a JPEG without decoding it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.camera.uvc_jpeg import jpeg_size


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
