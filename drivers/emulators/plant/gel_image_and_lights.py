"""The emulated camera's own optics: three coloured lights shade the gel's painted underside.

A sensor with a dark skin under clear gel is seen in grey instead (``translucent``).

Every pixel is lit by lights beside the gel (Lambert, inverse power of the distance, a soft
terminator because the real lights are bars), by a broad highlight (Blinn 1977), and by light that
the gel scatters everywhere. Colours mix in the sensor's filters, and a gamma with a soft shoulder
turns light into grey levels. Nothing here is fitted to images, and nothing is a polynomial of
slopes: a calibration has to find out for itself.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from drivers.emulators.plant.gel_response import Plant, SurfaceProfile
from drivers.emulators.plant.relief_shadows_and_texture import (
    Relief,
    gel_texture,
    relief_of,
    visible_share,
)
from drivers.emulators.plant.truth import EmulatedUnit, GelLight, MarkerGrid, PlantTruth, Tip
from tacauchy_rig.core.arrays import Float32Array, FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError

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
class View:
    """The raw frame's geometry: image right is base +x, image down is base +y."""

    # Of the raw frame [px].
    width: int
    height: int
    m_per_px: tuple[float, float]  # real scale in x and y [m]
    rotation_rad: float  # of the camera about its axis
    shift_m: tuple[float, float]  # where the gel's centre is seen, from the image's centre [m]

    def gel_points(self) -> tuple[Float32Array, Float32Array]:
        """Return x and y from the gel's centre for each pixel [m], shape [height, width]."""
        u = ((np.arange(self.width) + 0.5) - 0.5 * self.width) * self.m_per_px[0]
        v = ((np.arange(self.height) + 0.5) - 0.5 * self.height) * self.m_per_px[1]
        u, v = np.meshgrid(u - self.shift_m[0], v - self.shift_m[1])
        c, s = np.cos(self.rotation_rad), np.sin(self.rotation_rad)
        return (c * u + s * v).astype(np.float32), (-s * u + c * v).astype(np.float32)

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixel (column, row) that sees the point (x, y) [m] from the gel's centre."""
        c, s = float(np.cos(self.rotation_rad)), float(np.sin(self.rotation_rad))
        u, v = c * x - s * y + self.shift_m[0], s * x + c * y + self.shift_m[1]
        return (
            u / self.m_per_px[0] + 0.5 * self.width - 0.5,
            v / self.m_per_px[1] + 0.5 * self.height - 0.5,
        )


def view_of(truth: PlantTruth, size: tuple[int, int], factor: int = 1) -> View:
    """Return the true mapping between the gel and raw frames of ``size`` (columns, rows) [px].

    Args:
        factor: How many raw pixels a pixel of the view covers in each direction.
    """
    width, height = size
    if not (320 <= width <= 3280 and 240 <= height <= 2464):
        raise ConfigError(
            f"emulated camera: {width}x{height} px is not between 320x240 and 3280x2464",
            remedy="give a size in that range, for example 640x480",
        )
    unit = truth.unit
    kept = 1.0 - 2.0 * unit.crop
    columns, rows = unit.image_size
    scale = (
        unit.pixel_m[0] * columns / (kept * width) * (1.0 + truth.image_scale_error[0]),
        unit.pixel_m[1] * rows / (kept * height) * (1.0 + truth.image_scale_error[1]),
    )
    return View(
        width=width // factor,
        height=height // factor,
        m_per_px=(scale[0] * factor, scale[1] * factor),
        rotation_rad=truth.image_rotation_rad,
        shift_m=truth.image_shift_m,
    )


Region = tuple[slice, slice]
"""Rows and columns of a rectangle of pixels."""


class GelCamera:
    """Renders noise-free frames of one view of the gel.

    Frames are rendered no finer than they are scored, and enlarged, as lenses blur: a camera that
    shows shadows has time for no more pixels.
    """

    def __init__(self, truth: PlantTruth, size: tuple[int, int]) -> None:
        unit = self._unit = truth.unit
        self._factor = _rendering_factor(unit, size)
        view = self._view = view_of(truth, size, self._factor)
        self._x, self._y = view.gel_points()
        self._lights = _Lights(truth.light_gain, unit, self._x, self._y)
        texture = gel_texture(view.width, view.height, seed=truth.seed)
        edge_m = 0.495 * max(unit.pad_size_m)
        vignette = 1.0 - 0.12 * (self._x * self._x + self._y * self._y) / edge_m**2
        self._shade = np.maximum(vignette, 0.1).astype(np.float32) * texture
        self._whole: Region = slice(0, view.height), slice(0, view.width)
        self._blur_px = _BLUR_M / view.m_per_px[0]
        self._response = _response_curve()

    def enlarged(self, image: ImageArray) -> ImageArray:
        """Return a rendered frame with all pixels of the raw one, smoothly."""
        if self._factor == 1:
            return image
        size = (image.shape[1] * self._factor, image.shape[0] * self._factor)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)

    def region(self, profile: SurfaceProfile) -> Region | None:
        """Return the pixels that a press changes; None where it changes none."""
        relief = self._relief(profile)
        if relief is None:
            return None
        if self._unit.markers is not None:
            return self._whole
        reach = relief.reach_m + 4.0 * _BLUR_M
        column, row = self._view.pixel(*relief.centre)
        half_width, half_height = (reach / scale for scale in self._view.m_per_px)
        left, right = max(0, int(column - half_width)), int(column + half_width) + 2
        top, bottom = max(0, int(row - half_height)), int(row + half_height) + 2
        right, bottom = min(right, self._view.width), min(bottom, self._view.height)
        if right <= left or bottom <= top:
            return None
        return slice(top, bottom), slice(left, right)

    def render(
        self, profile: SurfaceProfile | None, *, region: Region | None = None, light: float = 1.0
    ) -> ImageArray:
        """Return a frame, BGR, shape [rows, columns, 3].

        Args:
            profile: The pressed surface, or None for the unloaded gel.
            light: Gain of all lights, for their drift.
        """
        rows, columns = region or self._whole
        margin = int(np.ceil(3.0 * self._blur_px)) + 1
        padded: Region = (
            slice(max(0, rows.start - margin), min(self._view.height, rows.stop + margin)),
            slice(max(0, columns.start - margin), min(self._view.width, columns.stop + margin)),
        )
        gain = np.full((padded[0].stop - padded[0].start, 1), light, np.float32)
        if self._unit.markers is not None:
            gain = marker_reflectance(self._unit.markers, profile, self._view)[padded] * gain
        linear = self._linear_light(self._relief(profile), padded, gain)
        blurred = cv2.GaussianBlur(linear, (0, 0), self._blur_px)
        blurred = blurred[rows.start - padded[0].start :, columns.start - padded[1].start :]
        image = np.empty((rows.stop - rows.start, columns.stop - columns.start, 3), np.uint8)
        for band in _bands(image):
            light_in_steps = blurred[band, : image.shape[1]] * _STEPS_PER_UNIT
            image[band] = self._response[
                np.minimum(light_in_steps, _STEP_COUNT - 1).astype(np.intp)
            ]
        return image

    def _relief(self, profile: SurfaceProfile | None) -> Relief | None:
        """Return the press as this camera needs it; None without contact."""
        dome_radius_m = self._unit.gel.dome_radius_m
        return None if profile is None else relief_of(profile, dome_radius_m=dome_radius_m)

    def _linear_light(
        self, relief: Relief | None, region: Region, gain: Float32Array
    ) -> Float32Array:
        rows, columns = region
        x, y = self._x[region], self._y[region]
        linear = np.empty((*x.shape, 3), np.float32)
        # What dents leave of each light.
        shares = np.broadcast_to(np.float32(1.0), (len(_LIGHT_AZIMUTH), *x.shape))
        if relief is not None and self._unit.shadows:
            toward = self._lights.toward[(..., *region)]
            shares = np.stack([visible_share(relief, x, y, each) for each in toward])
        for band in _bands(linear):
            part = slice(rows.start + band.start, rows.start + band.stop), columns
            shade = self._shade[part] * gain[band]
            if self._unit.light is GelLight.TRANSLUCENT:
                linear[band] = (scattered_light(relief, x[band], y[band]) * shade)[..., None]
            else:
                linear[band] = self._coloured(relief, part, shade, shares[:, band])
        return linear

    def _coloured(
        self, relief: Relief | None, part: Region, shade: Float32Array, shares: Float32Array
    ) -> Float32Array:
        x, y = self._x[part], self._y[part]
        slope_x, slope_y, crease = self._slopes(relief, x, y)
        steepness = slope_x * slope_x + slope_y * slope_y
        inverse: Float32Array = np.reciprocal(np.sqrt(np.float32(1.0) + steepness))
        normal = (-slope_x * inverse, -slope_y * inverse, inverse)
        colours = list(self._lights.shaded(part, normal, crease, shares) * shade)
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


class _Lights:
    """The coloured bars of lights, as each pixel sees them.

    Attributes:
        toward: Unit vectors from the gel to the lights, shape [light, 3, height, width].
    """

    def __init__(
        self, gains: Sequence[float], unit: EmulatedUnit, x: Float32Array, y: Float32Array
    ) -> None:
        away_m = _LIGHT_DISTANCE * max(unit.pad_size_m)
        share = _SHADOW_LIGHT_HEIGHT if unit.shadows else _LIGHT_HEIGHT
        height_m = np.float32(share * unit.gel.thickness_m)
        to_x = _of_each(away_m * np.cos(_LIGHT_AZIMUTH)) - x
        to_y = _of_each(away_m * np.sin(_LIGHT_AZIMUTH)) - y
        distance: Float32Array = np.sqrt(to_x * to_x + to_y * to_y + height_m**2)
        near = (away_m / distance) ** np.float32(_FALLOFF)
        self.toward = np.stack([to_x, to_y, np.broadcast_to(height_m, to_x.shape)], axis=1)
        self.toward /= distance[:, None]
        half = self.toward + _of_each(np.array([0.0, 0.0, 1.0]))
        length = np.sqrt(_dot(half, list(np.moveaxis(half, 1, 0))))
        self._half = np.asarray(half / length[:, None], np.float32)
        self._direct = near * _of_each(np.multiply(gains, _DIRECT))
        self._shine = near * _of_each(np.multiply(gains, _HIGHLIGHT))
        self._scattered = np.sqrt(near) * _of_each(np.multiply(gains, _SCATTERED))

    def shaded(
        self,
        region: Region,
        normal: Sequence[Float32Array],
        crease: Float32Array,
        shares: Float32Array,
    ) -> Float32Array:
        """Return the light that reaches the camera from each pixel of ``region``, [light, ...].

        Args:
            normal: Of the gel, by component.
            shares: Of each light that is not hidden.
        """
        part = (..., *region)
        cosine = _dot(self.toward[part], normal)
        lit = 0.5 * (cosine + np.sqrt(cosine * cosine + np.float32(_TERMINATOR**2)))
        shine = np.maximum(_dot(self._half[part], normal), 0.0)
        for _ in range(4):
            shine = shine * shine
        direct = self._direct[part] * lit + self._shine[part] * shine
        light: Float32Array = direct * shares + self._scattered[part] * (1.0 + crease)
        return light


def _of_each(values: FloatArray) -> Float32Array:
    """Return numbers to go with arrays of [light, height, width]."""
    return values.astype(np.float32)[:, None, None]


def _dot(vectors: Float32Array, normal: Sequence[Float32Array]) -> Float32Array:
    x, y, z = np.moveaxis(vectors, 1, 0)
    dot: Float32Array = x * normal[0] + y * normal[1] + z * normal[2]
    return dot


def _bands(image: Float32Array | ImageArray) -> list[slice]:
    rows, columns = image.shape[:2]
    height = max(1, _BAND_PX // columns)
    return [slice(top, min(top + height, rows)) for top in range(0, rows, height)]


def _response_curve() -> ImageArray:
    light = np.arange(_STEP_COUNT) / _STEPS_PER_UNIT
    room = 1.0 - _SHOULDER
    bent = _SHOULDER + room * (1.0 - np.exp(-(light - _SHOULDER) / room))
    exposed = np.where(light > _SHOULDER, bent, light)
    return np.round(255.0 * exposed ** (1.0 / _GAMMA)).astype(np.uint8)


def _rendering_factor(unit: EmulatedUnit, size: tuple[int, int]) -> int:
    """Return how many raw pixels a rendered pixel covers in each direction."""
    scored = unit.image_size[0] / (1.0 - 2.0 * unit.crop)  # columns of a raw frame
    common = math.gcd(*size)
    factors = [n for n in range(1, common + 1) if common % n == 0 and size[0] / n >= scored]
    return max(factors, default=1)


_LEVEL = 0.42  # linear light of the unloaded gel in the middle of the frame
_REMAINING = 0.22  # share of it that a gel pressed away would still send
_DEPTH_M = 0.62e-3  # over which the rest falls to 1/e


def scattered_light(relief: Relief | None, x: Float32Array, y: Float32Array) -> Float32Array:
    """Return the light that comes back from each point x, y [m] of the gel, same shape."""
    if relief is None:
        return np.full_like(x, _LEVEL)
    dent = np.maximum(relief.bulge_at(x, y), np.float32(0.0))
    falling = np.exp(dent * np.float32(-1.0 / _DEPTH_M))
    light: Float32Array = np.float32(_LEVEL) * (
        np.float32(_REMAINING) + np.float32(1.0 - _REMAINING) * falling
    )
    return light


_REFLECTANCE = 0.12  # of a printed dot, over the paint's
_EDGE_M = 4e-5  # over which a dot's edge is blurred


def moved_dots(grid: MarkerGrid, profile: SurfaceProfile | None) -> FloatArray:
    """Return the centres on the pressed surface [m], shape [rows * columns, 2]."""
    rest = grid.rest()
    if profile is None or profile.depth_m <= 0.0:
        return rest
    arm = rest - np.asarray(profile.centre)
    radius = np.maximum(np.linalg.norm(arm, axis=-1, keepdims=True), 1e-12)
    shift = np.interp(radius, profile.radius_rest, profile.radius - profile.radius_rest)
    moved: FloatArray = rest + arm / radius * shift
    return moved


def marker_reflectance(
    grid: MarkerGrid, profile: SurfaceProfile | None, view: View
) -> Float32Array:
    """Return what the dots leave of the paint's reflectance, shape [height, width]."""
    reflectance = np.ones((view.height, view.width), np.float32)
    x, y = view.gel_points()
    for centre_x, centre_y in moved_dots(grid, profile):
        column, row = view.pixel(float(centre_x), float(centre_y))
        reach = (grid.radius_m + 3 * _EDGE_M) / min(view.m_per_px)
        rows = slice(max(0, int(row - reach)), max(0, int(row + reach) + 2))
        columns = slice(max(0, int(column - reach)), max(0, int(column + reach) + 2))
        distance = np.hypot(x[rows, columns] - centre_x, y[rows, columns] - centre_y)
        cover = np.clip((grid.radius_m - distance) / _EDGE_M + 0.5, 0.0, 1.0)
        reflectance[rows, columns] *= 1.0 - (1.0 - _REFLECTANCE) * cover
    return reflectance


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
    image = camera.enlarged(camera.render(profile))
    if noise_seed is None:
        return image
    noise = np.random.default_rng([truth.seed, 3, noise_seed]).standard_normal(image.shape)
    noisy = image + truth.image_noise_levels * noise
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


@lru_cache(maxsize=4)
def _camera(truth: PlantTruth, size: tuple[int, int]) -> GelCamera:
    return GelCamera(truth, size)


@lru_cache(maxsize=8)
def _plant(truth: PlantTruth, tip: Tip) -> Plant:
    return Plant(truth, tip)
