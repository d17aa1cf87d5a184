"""Single frames of the emulated world, without any process."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.optics import GelCamera
from drivers.emulators.plant.tips import Tip
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.plant.view import view_of
from tacauchy_rig.core.arrays import ImageArray

_LARGEST_WIDTH = 960  # beyond it frames are rendered smaller and enlarged, as lenses blur


def rendering_factor(width: int, height: int) -> int:
    """Return how many raw pixels a rendered pixel covers in each direction."""
    common = math.gcd(width, height)
    factors = (n for n in range(1, common + 1) if common % n == 0 and width // n <= _LARGEST_WIDTH)
    return next(factors, 1)


def enlarged(image: ImageArray, factor: int) -> ImageArray:
    """Return ``image`` with ``factor`` times as many pixels each way, smoothly."""
    if factor == 1:
        return image
    size = (image.shape[1] * factor, image.shape[0] * factor)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def render_press(
    truth: PlantTruth,
    tip: Tip,
    depth_m: float,
    size: tuple[int, int] = (640, 480),
    *,
    centre_m: tuple[float, float] = (0.0, 0.0),
    lean_rad: tuple[float, float] | None = None,
    noise_seed: int | None = 0,
) -> ImageArray:
    """Render one raw frame, as the emulated camera would send it before JPEG.

    Args:
        truth: The emulated world; its pose and depth errors do not enter here.
        tip: What is pressed.
        depth_m: How deep, below the gel under the tip [m]; 0 is the no-contact frame.
        size: Width and height of the raw frame [px]; 15 % on each side is border.
        centre_m: Where, from the gel's centre, along image right and down [m].
        lean_rad: Lean of the contact towards x and y [rad]; None is the mounting's.
        noise_seed: Another number gives other noise; None gives none.

    Returns:
        BGR, shape [height, width, 3].
    """
    camera = _camera(truth, size)
    profile = None
    if depth_m > 0.0:
        lean = truth.tilt_rad if lean_rad is None else lean_rad
        profile = _plant(truth, tip).surface_at(depth_m, centre_m, lean)
    image = enlarged(camera.render(profile), rendering_factor(*size))
    if noise_seed is None:
        return image
    noise = np.random.default_rng([truth.seed, 3, noise_seed]).standard_normal(image.shape)
    noisy = image + truth.image_noise_levels * noise
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


@lru_cache(maxsize=4)
def _camera(truth: PlantTruth, size: tuple[int, int]) -> GelCamera:
    return GelCamera(truth, view_of(truth, size).scaled(rendering_factor(*size)))


@lru_cache(maxsize=8)
def _plant(truth: PlantTruth, tip: Tip) -> Plant:
    return Plant(truth, tip)
