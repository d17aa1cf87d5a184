"""The camera's frames at a twin's size, and what is left of them in the contact."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.app.twin.images import CameraImages, contact_residual

VIEW = CameraGeometry.centred(80, 60, scale_x_m=1e-4, scale_y_m=1e-4)


def _jpeg(width: int, height: int) -> bytes:
    image = np.full((height, width, 3), 90, np.uint8)
    image[:, width // 2 :, 0] = 200  # blue, as OpenCV has it
    return bytes(cv2.imencode(".jpg", image)[1])


@pytest.mark.parametrize("frame_width", [160, 640, 3280])
def test_a_frame_becomes_an_image_of_the_views_size(frame_width: int) -> None:
    """Whatever the decoder leaves out: RGB, its right half blue."""
    images = CameraImages(VIEW, crop_fraction=0.15, frame_width_px=frame_width)
    image = images.of(_jpeg(frame_width, frame_width * 3 // 4))
    assert image is not None
    assert image.shape == (60, 80, 3)
    assert image[:, 50:, 2].mean() == pytest.approx(200, abs=8)
    assert image[:, :30, 2].mean() == pytest.approx(90, abs=8)


@pytest.mark.parametrize("jpeg", [b"", b"no picture", _jpeg(40, 30)])
def test_what_is_no_whole_image_is_none(jpeg: bytes) -> None:
    """Damaged bytes, none, and a frame that is smaller than the view."""
    assert CameraImages(VIEW, crop_fraction=0.0, frame_width_px=640).of(jpeg) is None


def test_the_residual_is_nothing_for_the_image_itself_and_one_without_contact() -> None:
    """And none is known where the real image shows no contact."""
    unloaded = np.full((60, 80, 3), 100, np.uint8)
    real = unloaded.copy()
    cv2.circle(real, (40, 30), 12, (160, 60, 130), -1)
    assert contact_residual(real, real, unloaded) == 0.0
    assert contact_residual(real, unloaded, unloaded) == pytest.approx(1.0)
    assert contact_residual(unloaded, real, unloaded) is None
