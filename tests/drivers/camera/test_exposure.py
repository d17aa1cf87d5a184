"""Images with too much light are told from images with enough."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.camera.exposure import clipped_ratio


def jpeg(white_rows: int) -> bytes:
    """Return a grey image of 240 x 320 pixels whose first rows are white."""
    image = np.full((240, 320, 3), 150, np.uint8)
    image[:white_rows] = 255
    return cv2.imencode(".jpg", image)[1].tobytes()


@pytest.mark.parametrize(("white_rows", "ratio"), [(0, 0.0), (60, 0.25), (240, 1.0)])
def test_the_share_of_white_pixels_is_found(white_rows: int, ratio: float) -> None:
    """An eighth of the size is enough to see it."""
    assert clipped_ratio(jpeg(white_rows)) == pytest.approx(ratio, abs=0.02)


def test_bytes_that_are_no_image_have_no_share() -> None:
    """A damaged frame says nothing about the light."""
    assert clipped_ratio(b"\xff\xd8 no image \xff\xd9") is None
