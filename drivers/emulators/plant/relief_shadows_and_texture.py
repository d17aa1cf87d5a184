"""The pressed surface as tables over the radius, and what takes light from it.

Every pixel looks its relief up; shadows of a dent and the paint's texture dim it.
"""

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from drivers.emulators.plant.gel_response import SurfaceProfile
from tacauchy_rig.core.arrays import Float32Array, FloatArray, IntArray

STEP_M = 4e-6
_FLAT_SLOPE = 6e-3  # a change of slope that moves no colour by half a grey level
_STEEPEST = 6.0
_SMOOTHING_M = 1.2e-5  # the paint does not follow an edge any sharper


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """One press, seen from the camera; heights count towards it."""

    centre: tuple[float, float]  # the indenter's axis from the gel's centre, x and y [m]
    tilt: tuple[float, float]  # tilt of the contact face towards x and y [rad]
    reach_m: float  # beyond this radius the image does not change
    slope: Float32Array  # radial slope beyond that of the dome, at multiples of ``STEP_M``
    curvature: Float32Array  # radial curvature [1/m], likewise
    inside: Float32Array  # 1 in contact, 0 outside, likewise
    bulge: Float32Array  # height towards the camera over the unloaded gel [m], likewise
    # 1 where the surface is tilted as the gel under it: under a ball; 0 elsewhere, likewise
    leaning: Float32Array
    # Height that a tilt of one radian adds on its own side, over the radius [1], at multiples of
    # ``STEP_M``.
    tilt_rise: Float32Array
    tilt_slope: Float32Array  # radial slope of that height [1], likewise

    def places(
        self, x: Float32Array, y: Float32Array
    ) -> tuple[Float32Array, Float32Array, Float32Array, IntArray]:
        """Return where points of the gel [m] lie from the axis (x, y, radius), and their index."""
        dx, dy = x - np.float32(self.centre[0]), y - np.float32(self.centre[1])
        radius = np.sqrt(dx * dx + dy * dy)
        index = np.minimum(radius * np.float32(1.0 / STEP_M), self.slope.size - 1)
        return dx, dy, radius, index.astype(np.int32)

    def bulge_at(self, x: Float32Array, y: Float32Array) -> Float32Array:
        """Return the bulge at points of the gel, x and y from its centre [m]."""
        dx, dy, _, index = self.places(x, y)
        along = np.float32(self.tilt[0]) * dx + np.float32(self.tilt[1]) * dy
        return np.asarray(self.bulge[index] + along * self.tilt_rise[index], np.float32)

    def tilt_slopes(
        self, dx: Float32Array, dy: Float32Array, radius: Float32Array, index: IntArray
    ) -> tuple[Float32Array, Float32Array]:
        """Return what the tilt adds to the slopes along x and y; arguments as of ``places``."""
        tilt_x, tilt_y = (np.float32(tilt) for tilt in self.tilt)
        tilt_rise = self.tilt_rise[index]
        along = (tilt_x * dx + tilt_y * dy) * (self.tilt_slope[index] - tilt_rise)
        along /= np.maximum(radius * radius, np.float32(1e-18))
        even = self.leaning[index] + tilt_rise
        added = tilt_x * even + along * dx, tilt_y * even + along * dy
        return np.asarray(added[0], np.float32), np.asarray(added[1], np.float32)


def relief_of(profile: SurfaceProfile, *, dome_radius_m: float) -> Relief | None:
    """Return the relief of a pressed surface, or None where there is no contact."""
    if profile.depth_m <= 0.0:
        return None
    last = float(profile.radius[-1])
    radius = np.arange(0.0, last, STEP_M)
    height = np.interp(radius, profile.radius, -profile.height)
    slope = np.clip(_smoothed_slope(height), -_STEEPEST, _STEEPEST)
    curvature = np.gradient(slope, STEP_M)
    inside = np.clip((profile.contact_radius - radius) / (2 * STEP_M) + 0.5, 0.0, 1.0)
    extra = slope - radius / dome_radius_m * (1.0 - inside)
    leaning, tilt_rise, tilt_slope = inside, *np.zeros((2, radius.size))
    if len(profile.tilt_height):
        leaning = np.zeros_like(inside)
        tilt_height = np.interp(radius, profile.radius, -profile.tilt_height)
        tilt_slope = _smoothed_slope(tilt_height, reflected="odd")
        tilt_rise = np.divide(tilt_height, radius, out=tilt_slope.copy(), where=radius > 0.0)
    shown = np.abs(extra) + math.hypot(*profile.tilt) * np.abs(tilt_slope)
    changed = np.flatnonzero(shown > _FLAT_SLOPE)
    end = int(changed[-1]) + 2 if changed.size else 2
    reach = end * STEP_M
    fade = np.clip((reach - radius[:end]) / (0.1 * reach), 0.0, 1.0)
    fading = {
        "slope": extra,
        "curvature": curvature,
        "bulge": height - 0.5 * radius**2 / dome_radius_m,
        "tilt_rise": tilt_rise,
        "tilt_slope": tilt_slope,
    }
    tables = {name: values[:end] * fade for name, values in fading.items()}
    tables |= {"inside": inside[:end], "leaning": leaning[:end]}
    ended = {name: np.append(each, 0.0).astype(np.float32) for name, each in tables.items()}
    return Relief(centre=profile.centre, tilt=profile.tilt, reach_m=reach, **ended)


def _smoothed_slope(
    height: FloatArray, *, reflected: Literal["even", "odd"] = "even"
) -> FloatArray:
    half = round(3 * _SMOOTHING_M / STEP_M)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * STEP_M / _SMOOTHING_M) ** 2)
    padded = np.pad(height, half, mode="reflect", reflect_type=reflected)
    smooth = np.convolve(padded, kernel / kernel.sum(), mode="valid")
    return np.gradient(smooth, STEP_M)


_STRIDE = 2  # of pixels: shadows are soft
_LIGHT_SPREAD = 0.09  # height of the light over its distance: shadows soften as they grow longer
# Each is half the spread farther than the one before: else a wall's shadow ends early, in steps.
_SAMPLES_M = tuple(float(s) for s in np.geomspace(1e-4, 7.2e-3, 102))


def visible_share(
    relief: Relief, x: Float32Array, y: Float32Array, toward: Float32Array
) -> Float32Array:
    """Return how much of a light each point of the gel sees, 0 to 1.

    Args:
        x, y: Points of the gel, one a pixel [m], shape [height, width].
        toward: Unit vectors to the light, third component away from the gel, [3, height, width].
    """
    size = x.shape[::-1]
    coarse = tuple(-(-count // _STRIDE) for count in size)
    # In the middles of blocks of pixels
    x, y, along_x, along_y, up = (
        np.asarray(cv2.resize(part, coarse), np.float32) for part in (x, y, *toward)
    )
    own = relief.bulge_at(x, y)
    share, highest = np.ones_like(x), float(relief.bulge.max() - own.min())
    grazing = float(up.min()) - 0.5 * _LIGHT_SPREAD
    for sample in _SAMPLES_M:
        if sample * grazing > highest:
            break  # nothing reaches up to the light from so far
        step = np.float32(sample)
        there = relief.bulge_at(x + step * along_x, y + step * along_y)
        clearance = own + step * up - there
        softness = np.float32(_LIGHT_SPREAD * sample)
        np.minimum(share, np.float32(0.5) + clearance / softness, out=share)
    visible = cv2.resize(np.clip(share, 0.0, 1.0), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(visible, np.float32)


# Cells across the frame (columns, rows) and strength of each layer of noise.
_LAYERS = (((8, 6), 0.010), ((48, 36), 0.004), ((456, 342), 0.004))
_SMUDGE_COUNT = 14


def gel_texture(width: int, height: int, *, seed: int) -> Float32Array:
    """Return the paint's reflectance around one, shape [height, width]; the same at any size."""
    random = np.random.default_rng([seed, 2])
    texture = np.ones((height, width), np.float32)
    for (columns, rows), strength in _LAYERS:
        cells = random.standard_normal((rows, columns)).astype(np.float32)
        texture += strength * cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC)
    column = np.linspace(0.0, 1.0, width, dtype=np.float32)
    row = np.linspace(0.0, 1.0, height, dtype=np.float32)[:, None]
    for _ in range(_SMUDGE_COUNT):
        centre_x, centre_y = random.uniform(0.05, 0.95, 2)
        size_x, size_y = random.uniform(0.003, 0.010, 2)
        strength = random.uniform(0.01, 0.035)
        spot = ((column - centre_x) / size_x) ** 2 + ((row - centre_y) / (size_y * 4 / 3)) ** 2
        texture -= np.float32(strength) * np.exp(-0.5 * spot, dtype=np.float32)
    return texture
