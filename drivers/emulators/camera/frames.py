"""The emulated camera's frames: rendered where they change, spliced everywhere else.

Noise is real but rationed. The unloaded gel exists in a few noisy versions, of which each frame
mixes rows at random, and one row is made anew for every frame; so is a contact until it, too, has
a few versions. A slow drift of the lights reaches the frames through those renewals.
"""

from __future__ import annotations

import random
import threading
from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np

from drivers.emulators.camera.jpeg import MCU_PX, JpegMosaic, Tiles
from drivers.emulators.plant.arrays import ImageArray
from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.optics import GelCamera, Region
from drivers.emulators.plant.still import enlarged, rendering_factor
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.plant.view import view_of

_MARGIN_PX = 64


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

    def added(self, block: ImageArray) -> ImageArray:
        """Return ``block`` [rows, columns, 3] with noise."""
        rows, columns = block.shape[:2]
        top = int(self._random.integers(0, self._above.shape[0] - rows + 1))
        left = int(self._random.integers(0, self._above.shape[1] - columns + 1))
        window = slice(top, top + rows), slice(left, left + columns)
        brighter = cv2.add(block, self._above[window])
        return np.asarray(cv2.subtract(brighter, self._below[window]), np.uint8)


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
_VERSION_COUNT = 4
_CACHE_BYTES = 96_000_000
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


@dataclass(slots=True)
class _Contact:
    """A contact's place on the tile grid, its uppermost tiles before noise, its versions."""

    row: int
    column: int
    first_row: ImageArray
    versions: list[Tiles]
    byte_count: int


class FrameFactory:
    """Makes JPEG frames of one plant.

    ``prepare`` may run in another thread than the rest: what it makes is published whole.
    """

    def __init__(
        self,
        plant: Plant,
        width: int,
        height: int,
    ) -> None:
        self.plant = plant
        self.mosaic = JpegMosaic(width, height)
        self._factor = rendering_factor(width, height)
        self._camera = GelCamera(
            plant.truth, view_of(plant.truth, (width, height)).scaled(self._factor)
        )
        self._random = random.Random(plant.truth.seed)  # noqa: S311 - noise, not a secret
        self._noise = NoisePool(plant.truth, width, height)
        self._stamped = height * plant.truth.unit.crop >= STAMP_HEIGHT_PX
        self._lock = threading.Lock()
        self._contacts: OrderedDict[PressKey, _Contact | None] = OrderedDict()
        self._light_step = 0
        self._unloaded = self._camera.render(None)
        whole = self._raw(self._unloaded, self._camera.whole, self._whole)
        self._versions = [self._encode(whole) for _ in range(_VERSION_COUNT)]
        self._renewed_rows = 0
        # Made beforehand: too much light holds no camera up.
        glare = self._camera.render(None, light=_OVEREXPOSURE)
        self._overexposed = self._encode(self._raw(glare, self._camera.whole, self._whole))

    def is_ready(self, key: PressKey) -> bool:
        """Return whether ``compose`` can show ``key`` rather than an unloaded gel."""
        with self._lock:
            return not key.is_contact or key in self._contacts

    def prepare(self, key: PressKey) -> None:
        """Render what ``compose`` needs for ``key``: a first version, or one more."""
        if key.light != self._light_step:
            self._unloaded = self._camera.render(None, light=_gain(key))
            self._light_step = key.light
        if not key.is_contact:
            return
        with self._lock:
            known = self._contacts.get(key)
            finished = known is None or len(known.versions) >= _VERSION_COUNT
            if key in self._contacts and finished:
                self._contacts.move_to_end(key)
                return
        rendered = self._render_contact(key)
        with self._lock:
            if known is not None and rendered is not None:
                rendered.versions += known.versions
                rendered.byte_count += known.byte_count
            self._contacts[key] = rendered
            self._contacts.move_to_end(key)
            self._forget_oldest()

    def compose(self, key: PressKey, number: int) -> bytes:
        """Return the JPEG of ``key``, with ``number`` drawn in where a border is cropped away."""
        versions, pick = self._versions, self._random.randrange
        tiles = [list(versions[pick(_VERSION_COUNT)][row]) for row in range(self.mosaic.rows)]
        with self._lock:
            contact = self._contacts.get(key)
            version = self._random.choice(contact.versions) if contact is not None else []
        if contact is None:
            return self._finish(tiles, number)
        for i, row in enumerate(version):
            tiles[contact.row + i][contact.column : contact.column + len(row)] = row
        if not self._stamped:  # the contact's first row has noise of its own in every frame
            fresh = self._encode(contact.first_row)[0]
            tiles[contact.row][contact.column : contact.column + len(fresh)] = fresh
        return self._finish(tiles, number)

    def compose_overexposed(self, number: int) -> bytes:
        """Return a frame in which far too much light drowns everything."""
        return self._finish([list(row) for row in self._overexposed], number)

    def renew(self) -> None:
        """Make one row of one version of the unloaded gel anew, with the present light."""
        version, row = divmod(self._renewed_rows, self.mosaic.rows)
        self._versions[version][row] = self._encode(self._row_block(row))[0]
        self._renewed_rows = (self._renewed_rows + 1) % (_VERSION_COUNT * self.mosaic.rows)

    def _finish(self, tiles: Tiles, number: int) -> bytes:
        if not self._stamped:
            return self.mosaic.splice(tiles)
        columns = -(-STAMP_WIDTH_PX // self.mosaic.tile_width)
        strip = self._noise.added(self._row_block(0)[:, : columns * self.mosaic.tile_width])
        draw_number(strip, number)
        tiles[0][:columns] = self.mosaic.tiles(strip)[0]
        return self.mosaic.splice(tiles)

    def _render_contact(self, key: PressKey) -> _Contact | None:
        place = (key.x * PLACE_STEP_M, key.y * PLACE_STEP_M)
        profile = self.plant.surface_at(key.depth * DEPTH_STEP_M, place, self.plant.truth.tilt_rad)
        changed = self._camera.region(self._camera.relief(profile))
        if changed is None:
            return None
        wanted = self._on_tiles(changed)
        source = self._rendered_part(wanted)
        image = self._camera.render(profile, region=source, light=_gain(key))
        raw = self._raw(image, source, wanted)
        tiles = self._encode(raw)
        return _Contact(
            row=wanted.top // MCU_PX,
            column=wanted.left // self.mosaic.tile_width,
            first_row=raw[:MCU_PX].copy(),
            versions=[tiles],
            byte_count=sum(len(tile) for row in tiles for tile in row),
        )

    def _forget_oldest(self) -> None:
        total = sum(
            contact.byte_count for contact in self._contacts.values() if contact is not None
        )
        while total > _CACHE_BYTES and len(self._contacts) > 1:
            _, oldest = self._contacts.popitem(last=False)
            total -= oldest.byte_count if oldest is not None else 0

    def _encode(self, block: ImageArray) -> Tiles:
        return self.mosaic.tiles(self._noise.added(block))

    def _row_block(self, row: int) -> ImageArray:
        top = row * MCU_PX
        bottom = min(top + MCU_PX, self.mosaic.height)
        wanted = Region(left=0, top=top, right=self.mosaic.width, bottom=bottom)
        source = self._rendered_part(wanted)
        return self._raw(self._unloaded[source.slices], source, wanted)

    @property
    def _whole(self) -> Region:
        return Region(left=0, top=0, right=self.mosaic.width, bottom=self.mosaic.height)

    def _on_tiles(self, rendered: Region) -> Region:
        """Return the raw pixels of a rendered region, grown to whole tiles."""
        f, tile = self._factor, self.mosaic.tile_width
        return Region(
            left=rendered.left * f // tile * tile,
            top=rendered.top * f // MCU_PX * MCU_PX,
            right=min(-(-rendered.right * f // tile) * tile, self.mosaic.width),
            bottom=min(-(-rendered.bottom * f // MCU_PX) * MCU_PX, self.mosaic.height),
        )

    def _rendered_part(self, raw: Region) -> Region:
        """Return the rendered pixels that decide on raw ones, with a margin to interpolate in."""
        f, view = self._factor, self._camera.view
        margin = 0 if f == 1 else 1
        return Region(
            left=max(0, raw.left // f - margin),
            top=max(0, raw.top // f - margin),
            right=min(-(-raw.right // f) + margin, view.width),
            bottom=min(-(-raw.bottom // f) + margin, view.height),
        )

    def _raw(self, rendered: ImageArray, source: Region, wanted: Region) -> ImageArray:
        """Enlarge rendered pixels and cut out the raw ones that are wanted."""
        f = self._factor
        top, left = wanted.top - source.top * f, wanted.left - source.left * f
        rows, columns = wanted.bottom - wanted.top, wanted.right - wanted.left
        return enlarged(rendered, f)[top : top + rows, left : left + columns]


def _gain(key: PressKey) -> float:
    return 1.0 + key.light * LIGHT_STEP
