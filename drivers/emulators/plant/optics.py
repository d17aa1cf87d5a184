"""The emulated camera's own optics: three coloured lights shade the gel's painted underside.

A sensor with a dark skin under clear gel is seen in grey instead (``translucent``).

Every pixel is lit by lights beside the gel (Lambert, inverse power of the distance, a soft
terminator because the real lights are bars), by a broad highlight (Blinn 1977), and by light that
the gel scatters everywhere. Colours mix in the sensor's filters, and a gamma with a soft shoulder
turns light into grey levels. Nothing here is fitted to images, and nothing is a polynomial of
slopes: a calibration has to find out for itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from drivers.emulators.plant.gel import Plant, SurfaceProfile
from drivers.emulators.plant.relief import (
    Relief,
    gel_texture,
    relief_of,
    scattered_light,
    visible_share,
)
from drivers.emulators.plant.tips import Tip
from drivers.emulators.plant.truth import EmulatedUnit, GelLight, PlantTruth
from drivers.emulators.plant.view import View, marker_reflectance, view_of
from tacauchy_rig.core.arrays import Float32Array, ImageArray

_LIGHT_AZIMUTH = np.radians([-97.0, 94.0, 183.0])  # red above, green below, blue left
_LIGHT_DISTANCE = 15.5 / 25.25  # of the pad's longer side, from its middle
_LIGHT_HEIGHT = 0.85  # of the gel's thickness
_SHADOW_LIGHT_HEIGHT = 1.9  # likewise, of a sensor that shows shadows
_FALLOFF = 1.25
_DIRECT = (0.70, 0.68, 0.77)
_SCATTERED = (0.235, 0.240, 0.290)
_HIGHLIGHT = (0.10, 0.10, 0.11)  # times the sixteenth power of the half angle's cosine
_TERMINATOR = 0.06
_CREASE_M = 3.5e-5  # scattered light changes by this times the surface's curvature
_CREASE_LIMIT = 0.35
_MIXING = np.array([[0.91, 0.06, 0.03], [0.05, 0.89, 0.06], [0.02, 0.07, 0.91]])
_BGR_MIXING = _MIXING[::-1, ::-1].astype(np.float32)
_GAMMA = 2.2
_SHOULDER = 0.82  # light above this share of full scale is compressed
_BLUR_M = 4.5e-5
_STEPS_PER_UNIT = 1024
_STEP_COUNT = 4096
_BAND_PX = 16_000  # pixels worked on together: what the processor's cache holds


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A rectangle of pixels, ends exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


class GelCamera:
    """Renders noise-free frames of one view of the gel."""

    def __init__(self, truth: PlantTruth, view: View) -> None:
        self.view = view
        self._markers = truth.unit.markers
        self._unit = unit = truth.unit
        self._dome_radius_m = unit.gel.dome_radius_m
        self._x, self._y = view.gel_points()
        self._lights = [
            _Light(i, truth.light_gain[i], unit, self._x, self._y)
            for i in range(len(_LIGHT_AZIMUTH))
        ]
        self._shade = _vignette(self._x, self._y, unit) * gel_texture(view, seed=truth.seed)
        self._blur_px = _BLUR_M / view.m_per_px[0]
        self._response = _response_curve()

    @property
    def whole(self) -> Region:
        """The whole frame."""
        return Region(left=0, top=0, right=self.view.width, bottom=self.view.height)

    def relief(self, profile: SurfaceProfile | None) -> Relief | None:
        """Return the press as this camera needs it; None without contact."""
        if profile is None:
            return None
        return relief_of(profile, dome_radius_m=self._dome_radius_m)

    def region(self, relief: Relief | None) -> Region | None:
        """Return the pixels that a press changes; None where it changes none."""
        if relief is None:
            return None
        if self._markers is not None:
            return self.whole
        reach = relief.reach_m + 4.0 * _BLUR_M
        column, row = self.view.pixel(*relief.centre)
        half_width, half_height = (reach / scale for scale in self.view.m_per_px)
        left, right = max(0, int(column - half_width)), int(column + half_width) + 2
        top, bottom = max(0, int(row - half_height)), int(row + half_height) + 2
        right, bottom = min(right, self.view.width), min(bottom, self.view.height)
        if right <= left or bottom <= top:
            return None
        return Region(left=left, top=top, right=right, bottom=bottom)

    def render(
        self,
        profile: SurfaceProfile | None,
        *,
        region: Region | None = None,
        light: float = 1.0,
    ) -> ImageArray:
        """Return a frame, BGR, shape [rows, columns, 3].

        Args:
            profile: The pressed surface, or None for the unloaded gel.
            region: Which pixels; all by default.
            light: Gain of all lights, for their drift.
        """
        wanted = region or self.whole
        margin = int(np.ceil(3.0 * self._blur_px)) + 1
        padded = Region(
            left=max(0, wanted.left - margin),
            top=max(0, wanted.top - margin),
            right=min(self.view.width, wanted.right + margin),
            bottom=min(self.view.height, wanted.bottom + margin),
        )
        gain = np.full((padded.bottom - padded.top, 1), light, np.float32)
        if self._markers is not None:
            gain = marker_reflectance(self._markers, profile, self.view)[padded.slices] * gain
        linear = self._linear_light(self.relief(profile), padded, gain)
        blurred = cv2.GaussianBlur(linear, (0, 0), self._blur_px)
        top, left = wanted.top - padded.top, wanted.left - padded.left
        rows, columns = wanted.bottom - wanted.top, wanted.right - wanted.left
        image = np.empty((rows, columns, 3), np.uint8)
        for band in _bands(rows, columns):
            light_in_steps = blurred[top:, left : left + columns][band] * _STEPS_PER_UNIT
            image[band] = self._response[
                np.minimum(light_in_steps, _STEP_COUNT - 1).astype(np.intp)
            ]
        return image

    def _linear_light(
        self, relief: Relief | None, region: Region, gain: Float32Array
    ) -> Float32Array:
        rows, columns = region.bottom - region.top, region.right - region.left
        linear = np.empty((rows, columns, 3), np.float32)
        shown = self._shown(relief, region)
        for band in _bands(rows, columns):
            part = Region(
                left=region.left,
                top=region.top + band.start,
                right=region.right,
                bottom=region.top + band.stop,
            )
            shade = self._shade[part.slices] * gain[band]
            if self._unit.light is GelLight.TRANSLUCENT:
                linear[band] = self._grey(relief, part, shade)
            else:
                shares = [None if share is None else share[band] for share in shown]
                linear[band] = self._coloured(relief, part, shade, shares)
        return linear

    def _shown(self, relief: Relief | None, region: Region) -> list[Float32Array | None]:
        """Return the share of each light that dents leave, None where they leave all of it."""
        if relief is None or not self._unit.shadows:
            return [None] * len(self._lights)
        x, y = self._x[region.slices], self._y[region.slices]
        return [visible_share(relief, x, y, light.toward(region)) for light in self._lights]

    def _grey(self, relief: Relief | None, part: Region, shade: Float32Array) -> Float32Array:
        light = scattered_light(relief, self._x[part.slices], self._y[part.slices]) * shade
        return np.repeat(light[..., None], 3, axis=2).astype(np.float32)

    def _coloured(
        self,
        relief: Relief | None,
        part: Region,
        shade: Float32Array,
        shares: list[Float32Array | None],
    ) -> Float32Array:
        x, y = self._x[part.slices], self._y[part.slices]
        slope_x, slope_y, crease = self._slopes(relief, x, y)
        steepness = slope_x * slope_x + slope_y * slope_y
        inverse: Float32Array = np.reciprocal(np.sqrt(np.float32(1.0) + steepness))
        normal = (-slope_x * inverse, -slope_y * inverse, inverse)
        colours = [
            light.shaded(part, normal, crease, share) * shade
            for light, share in zip(self._lights, shares, strict=True)
        ]
        return np.asarray(cv2.transform(cv2.merge(colours[::-1]), _BGR_MIXING), np.float32)

    def _slopes(
        self, relief: Relief | None, x: Float32Array, y: Float32Array
    ) -> tuple[Float32Array, Float32Array, Float32Array]:
        """Return d(height towards the camera)/dx, /dy and the share of extra scattered light."""
        dome_x, dome_y = (np.float32(bend) for bend in self._unit.dome_curvatures)
        if relief is None:
            return dome_x * x, dome_y * y, np.zeros_like(x)
        dx, dy, radius, index = relief.places(x, y)
        radial = relief.slope[index] / np.maximum(radius, np.float32(1e-9))
        inside = relief.inside[index]
        outside = np.float32(1.0) - inside
        tilt_x, tilt_y = relief.tilt_slopes(dx, dy, radius, index)
        return (
            np.asarray(outside * dome_x * x + radial * dx + tilt_x, np.float32),
            np.asarray(outside * dome_y * y + radial * dy + tilt_y, np.float32),
            np.clip(
                relief.curvature[index] * np.float32(-_CREASE_M), -_CREASE_LIMIT, _CREASE_LIMIT
            ),
        )


class _Light:
    """One coloured bar of lights, as each pixel sees it."""

    def __init__(
        self, index: int, gain: float, unit: EmulatedUnit, x: Float32Array, y: Float32Array
    ) -> None:
        azimuth = float(_LIGHT_AZIMUTH[index])
        away_m = _LIGHT_DISTANCE * max(unit.pad_size_m)
        share = _SHADOW_LIGHT_HEIGHT if unit.shadows else _LIGHT_HEIGHT
        height_m = share * unit.gel.thickness_m
        to_x = np.float32(away_m * np.cos(azimuth)) - x
        to_y = np.float32(away_m * np.sin(azimuth)) - y
        distance = _length(to_x, to_y, np.full_like(to_x, height_m))
        near = (away_m / distance) ** np.float32(_FALLOFF)
        self._toward: tuple[Float32Array, ...] = (
            to_x / distance,
            to_y / distance,
            np.float32(height_m) / distance,
        )
        x_half, y_half, z_half = *self._toward[:2], self._toward[2] + np.float32(1.0)
        length = _length(x_half, y_half, z_half)
        self._half: tuple[Float32Array, ...] = (x_half / length, y_half / length, z_half / length)
        self._direct = (near * np.float32(gain * _DIRECT[index])).astype(np.float32)
        self._shine = (near * np.float32(gain * _HIGHLIGHT[index])).astype(np.float32)
        self._scattered = (np.sqrt(near) * np.float32(gain * _SCATTERED[index])).astype(np.float32)

    def toward(self, region: Region) -> tuple[Float32Array, ...]:
        """Return the unit vectors from the gel to the light in ``region``, by component."""
        return tuple(part[region.slices] for part in self._toward)

    def shaded(
        self,
        region: Region,
        normal: tuple[Float32Array, ...],
        crease: Float32Array,
        share: Float32Array | None,
    ) -> Float32Array:
        """Return the light that reaches the camera from each pixel of ``region``.

        Args:
            region: Which pixels.
            normal: Of the gel, by component.
            crease: Share of extra scattered light.
            share: Of the light that is not hidden; None is all of it.
        """
        cosine = _dot(self._toward, normal, region)
        lit = 0.5 * (cosine + np.sqrt(cosine * cosine + np.float32(_TERMINATOR**2)))
        shine = np.maximum(_dot(self._half, normal, region), 0.0)
        for _ in range(4):
            shine = shine * shine
        window = region.slices
        direct: Float32Array = self._direct[window] * lit + self._shine[window] * shine
        if share is not None:
            direct = direct * share
        light: Float32Array = direct + self._scattered[window] * (1.0 + crease)
        return light


def _length(x: Float32Array, y: Float32Array, z: Float32Array) -> Float32Array:
    length: Float32Array = np.sqrt(x * x + y * y + z * z)
    return length


def _dot(
    vectors: tuple[Float32Array, ...], normal: tuple[Float32Array, ...], region: Region
) -> Float32Array:
    x, y, z = (part[region.slices] for part in vectors)
    dot: Float32Array = x * normal[0] + y * normal[1] + z * normal[2]
    return dot


def _bands(rows: int, columns: int) -> list[slice]:
    height = max(1, _BAND_PX // columns)
    return [slice(top, min(top + height, rows)) for top in range(0, rows, height)]


def _vignette(x: Float32Array, y: Float32Array, unit: EmulatedUnit) -> Float32Array:
    edge_m = 0.495 * max(unit.pad_size_m)
    shade = 1.0 - 0.12 * (x * x + y * y) / edge_m**2
    return np.maximum(shade, 0.1).astype(np.float32)


def _response_curve() -> ImageArray:
    light = np.arange(_STEP_COUNT) / _STEPS_PER_UNIT
    room = 1.0 - _SHOULDER
    bent = _SHOULDER + room * (1.0 - np.exp(-(light - _SHOULDER) / room))
    exposed = np.where(light > _SHOULDER, bent, light)
    return np.round(255.0 * exposed ** (1.0 / _GAMMA)).astype(np.uint8)


def rendering_factor(truth: PlantTruth, size: tuple[int, int]) -> int:
    """Return how many raw pixels a rendered pixel covers in each direction.

    Frames are rendered no finer than they are scored, and enlarged, as lenses blur: a camera that
    shows shadows has time for no more pixels.

    Args:
        truth: Says how finely frames are scored.
        size: Width and height of the raw frame [px].
    """
    scored = truth.unit.image_size[0] / (1.0 - 2.0 * truth.unit.crop)  # columns of a raw frame
    common = math.gcd(*size)
    factors = [n for n in range(1, common + 1) if common % n == 0 and size[0] / n >= scored]
    return max(factors, default=1)


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
    tilt_rad: tuple[float, float] | None = None,
    noise_seed: int | None = 0,
) -> ImageArray:
    """Render one raw frame, as the emulated camera would send it before JPEG.

    Args:
        truth: The emulated world; its pose and depth errors do not enter here.
        tip: What is pressed.
        depth_m: How deep, below the gel under the tip [m]; 0 is the no-contact frame.
        size: Width and height of the raw frame [px]; 15 % on each side is border.
        centre_m: Where, from the gel's centre, along image right and down [m].
        tilt_rad: Tilt of the contact towards x and y [rad]; None is the mounting's.
        noise_seed: Another number gives other noise; None gives none.

    Returns:
        BGR, shape [height, width, 3].
    """
    camera = _camera(truth, size)
    profile = None
    if depth_m > 0.0:
        tilt = truth.tilt_rad if tilt_rad is None else tilt_rad
        profile = _plant(truth, tip).surface_at(depth_m, centre_m, tilt)
    image = enlarged(camera.render(profile), rendering_factor(truth, size))
    if noise_seed is None:
        return image
    noise = np.random.default_rng([truth.seed, 3, noise_seed]).standard_normal(image.shape)
    noisy = image + truth.image_noise_levels * noise
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


@lru_cache(maxsize=4)
def _camera(truth: PlantTruth, size: tuple[int, int]) -> GelCamera:
    return GelCamera(truth, view_of(truth, size).scaled(rendering_factor(truth, size)))


@lru_cache(maxsize=8)
def _plant(truth: PlantTruth, tip: Tip) -> Plant:
    return Plant(truth, tip)
