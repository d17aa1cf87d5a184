"""Which point of the gel each pixel of the emulated camera sees, and the dots printed there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.gel import SurfaceProfile
from drivers.emulators.plant.truth import MarkerGrid, PlantTruth
from tacauchy_rig.core.arrays import Float32Array, FloatArray
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """The raw frame's geometry: image right is base +x, image down is base +y.

    Attributes:
        width, height: Of the raw frame [px].
        m_per_px: Real scale in x and y [m].
        rotation_rad: Of the camera about its axis.
        shift_m: Where the gel's centre is seen, from the image's centre [m].
    """

    width: int
    height: int
    m_per_px: tuple[float, float]
    rotation_rad: float
    shift_m: tuple[float, float]

    def scaled(self, factor: int) -> View:
        """Return the same view with pixels ``factor`` times as large."""
        return View(
            width=-(-self.width // factor),
            height=-(-self.height // factor),
            m_per_px=(self.m_per_px[0] * factor, self.m_per_px[1] * factor),
            rotation_rad=self.rotation_rad,
            shift_m=self.shift_m,
        )

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


def view_of(truth: PlantTruth, size: tuple[int, int]) -> View:
    """Return the true mapping between the gel and raw frames of ``size`` (columns, rows) [px].

    Raises:
        ConfigError: The size is not one that such a camera has.
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
        width=width,
        height=height,
        m_per_px=scale,
        rotation_rad=truth.image_rotation_rad,
        shift_m=truth.image_shift_m,
    )


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
