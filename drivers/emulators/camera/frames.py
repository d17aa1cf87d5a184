"""The emulated camera's frames: rendered where a press changes them, with noise of their own."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.optics import GelCamera, Region
from drivers.emulators.plant.truth import PlantTruth
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import DeviceError

_MARGIN_PX = 64
# 0.84 MB at 3280x2464, what the real camera sends.
_ENCODING = (
    *(cv2.IMWRITE_JPEG_QUALITY, 94),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420),
)


def encode_jpeg(image: ImageArray) -> bytes:
    """Return a BGR image [rows, columns, 3] as the JPEG that a GelSight Mini would send."""
    encoded, data = cv2.imencode(".jpg", image, _ENCODING)
    if not encoded:
        raise DeviceError(f"emulated camera: a frame of {image.shape} could not be encoded")
    return data.tobytes()


class NoisePool:
    """Gaussian noise for frames of one size; each use begins at another place of the pool."""

    def __init__(self, truth: PlantTruth, width: int, height: int) -> None:
        self._random = np.random.default_rng([truth.seed, 4])
        shape = (height + _MARGIN_PX, width + _MARGIN_PX, 3)
        # Two pools, because OpenCV adds and subtracts bytes several times faster than it adds
        # signed numbers to them.
        self._above, self._below = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
        for row in range(0, shape[0], _MARGIN_PX):  # in parts: the floats need four times the room
            part = self._random.standard_normal(
                (min(_MARGIN_PX, shape[0] - row), *shape[1:]), np.float32
            )
            levels = np.round(part * truth.image_noise_levels)
            self._above[row : row + _MARGIN_PX] = np.maximum(levels, 0.0)
            self._below[row : row + _MARGIN_PX] = np.maximum(-levels, 0.0)

    def added(self, image: ImageArray) -> ImageArray:
        """Return ``image`` [rows, columns, 3] with noise."""
        brighter = cv2.add(image, self._above[self._window()])
        return np.asarray(cv2.subtract(brighter, self._below[self._window()]), np.uint8)

    def _window(self) -> tuple[slice, slice]:
        """Return a frame's rows and columns, anywhere in a pool."""
        top, left = self._random.integers(0, _MARGIN_PX + 1, 2)
        rows, columns = self._above.shape[0] - _MARGIN_PX, self._above.shape[1] - _MARGIN_PX
        return slice(top, top + rows), slice(left, left + columns)


BLOCK_PX = 8
BIT_COUNT = 32
STAMP_WIDTH_PX = BLOCK_PX * BIT_COUNT
STAMP_HEIGHT_PX = 2 * BLOCK_PX
DARK, BRIGHT = 16, 240


def draw_number(image: ImageArray, number: int) -> None:
    """Draw ``number`` into the top left corner of ``image`` [rows, columns, 3], in place."""
    bits = (number >> np.arange(BIT_COUNT)) & 1
    levels = np.where(np.stack([bits, 1 - bits]), BRIGHT, DARK).astype(np.uint8)
    blocks = levels.repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)
    image[:STAMP_HEIGHT_PX, :STAMP_WIDTH_PX] = blocks[:, :, None]


DEPTH_STEP_M = 4e-6
PLACE_STEP_M = 1e-5
LIGHT_STEP = 2e-3
# Contacts: a dwell shows a few, and a press none twice.
_KEPT_COUNT = 64
_OVEREXPOSURE = 4.0


@dataclass(frozen=True, slots=True)
class PressKey:
    """What distinguishes one rendered contact from another, in the steps above."""

    depth: int
    x: int
    y: int
    light: int

    @property
    def is_contact(self) -> bool:
        """False for the unloaded gel."""
        return self.depth > 0


class FrameFactory:
    """Makes frames of one plant: JPEG, or whatever ``encode`` makes of a BGR image.

    ``prepare`` may run in another thread than the rest: what it makes is published whole.

    Attributes:
        plant: The gel.
        newest: What was prepared last; the camera shows it until a newer one is.
    """

    def __init__(
        self,
        plant: Plant,
        width: int,
        height: int,
        encode: Callable[[ImageArray], bytes] = encode_jpeg,
    ) -> None:
        self.plant = plant
        self._encode = encode
        self._camera = GelCamera(plant.truth, (width, height))
        self._noise = NoisePool(plant.truth, width, height)
        self._stamped = height * plant.truth.unit.crop >= STAMP_HEIGHT_PX
        self._lock = threading.Lock()
        self._contacts: OrderedDict[PressKey, tuple[Region, ImageArray] | None] = OrderedDict()
        self.newest = PressKey(depth=0, x=0, y=0, light=0)
        self._light_step = 0
        self._unloaded = self._camera.render(None)
        # Made beforehand: too much light holds no camera up.
        self._overexposed = self._camera.render(None, light=_OVEREXPOSURE)

    def prepare(self, key: PressKey) -> None:
        """Render what ``compose`` needs for ``key``."""
        if key.light != self._light_step:
            self._unloaded = self._camera.render(None, light=_gain(key))
            self._light_step = key.light
        if key.is_contact and key not in self._contacts:
            contact = self._rendered(key)
            with self._lock:
                self._contacts[key] = contact
                while len(self._contacts) > _KEPT_COUNT:
                    self._contacts.popitem(last=False)
        self.newest = key

    def compose(self, key: PressKey, number: int) -> bytes:
        """Return the frame of ``key``, with ``number`` drawn in where a border is cropped away."""
        image = self._unloaded.copy()
        with self._lock:
            contact = self._contacts.get(key)
        if contact is not None:
            region, seen = contact
            image[region] = seen
        return self._sent(image, number)

    def compose_overexposed(self, number: int) -> bytes:
        """Return a frame in which far too much light drowns everything."""
        return self._sent(self._overexposed, number)

    def _rendered(self, key: PressKey) -> tuple[Region, ImageArray] | None:
        """Return what a press changes, where and how it is seen; None where that is nothing."""
        place = (key.x * PLACE_STEP_M, key.y * PLACE_STEP_M)
        profile = self.plant.surface_at(key.depth * DEPTH_STEP_M, place, self.plant.truth.tilt_rad)
        region = self._camera.region(profile)
        if region is None:
            return None
        return region, self._camera.render(profile, region=region, light=_gain(key))

    def _sent(self, image: ImageArray, number: int) -> bytes:
        raw = self._noise.added(self._camera.enlarged(image))
        if self._stamped:
            draw_number(raw, number)
        return self._encode(raw)


def _gain(key: PressKey) -> float:
    return 1.0 + key.light * LIGHT_STEP
