"""Images of scale targets with known scale, rotation and centre, for the tests."""

from typing import Any

import cv2
import numpy as np

from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import ImageArray

SUPERSAMPLING = 4
_PRINT_PX_M = 60e3


def printed_board(board: Any) -> np.ndarray:
    """Print OpenCV's board at 60 px/mm without margin; its middle is the target's middle."""
    width, height = (round(side * _PRINT_PX_M) for side in board.getRightBottomCorner()[:2])
    return board.generateImage((width, height), marginSize=0, borderBits=1)


def photograph(
    printed: np.ndarray, geometry: CameraGeometry, *, blur_px: float, noise: float, seed: int = 0
) -> ImageArray:
    """See a print, centred on the pad, through a camera with blur, noise and uneven light."""
    fine = SUPERSAMPLING
    rows, columns = np.mgrid[: geometry.height * fine, : geometry.width * fine]
    pixels = (np.stack([columns, rows], axis=-1) + 0.5) / fine - 0.5
    pad = geometry.to_pad(pixels)
    height, width = printed.shape
    map_x = (pad[..., 0] * _PRINT_PX_M + 0.5 * (width - 1)).astype(np.float32)
    map_y = (pad[..., 1] * _PRINT_PX_M + 0.5 * (height - 1)).astype(np.float32)
    printed = cv2.GaussianBlur(printed, (0, 0), 0.3 * geometry.mean_scale_m * _PRINT_PX_M / fine)
    seen = cv2.remap(
        printed, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255
    )
    size = (geometry.width, geometry.height)
    image = cv2.resize(seen, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    image = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px else image
    light = np.linspace(0.6, 0.9, geometry.width)[None, :]
    image = 25.0 + light * image
    image += np.random.default_rng(seed).normal(0.0, 1.0, image.shape) * noise
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def printed_dots(*, columns: int, rows: int, pitch_m: float, radius_m: float) -> np.ndarray:
    """Print dark dots at 60 px/mm with a margin of one pitch."""
    pitch, radius = pitch_m * _PRINT_PX_M, radius_m * _PRINT_PX_M
    width, height = round((columns + 1) * pitch), round((rows + 1) * pitch)
    y, x = np.mgrid[:height, :width].astype(np.float64)
    u = (x - 0.5 * (width - 1)) / pitch + 0.5 * (columns - 1)
    v = (y - 0.5 * (height - 1)) / pitch + 0.5 * (rows - 1)
    i, j = np.clip(np.rint(u), 0, columns - 1), np.clip(np.rint(v), 0, rows - 1)
    inside = np.hypot(u - i, v - j) * pitch < radius
    return np.where(inside, 20, 255).astype(np.uint8)
