"""The pressed surface as tables over the radius, ready to be looked up for every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.arrays import FloatArray, SingleArray
from drivers.emulators.plant.gel import SurfaceProfile

STEP_M = 4e-6
_FLAT_SLOPE = 6e-3  # a change of slope that moves no colour by half a grey level
_STEEPEST = 6.0
_SMOOTHING_M = 1.2e-5  # the paint does not follow an edge any sharper


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """One press, seen from the camera; heights count towards it.

    Attributes:
        centre: The indenter's axis from the gel's centre, x and y [m].
        tilt: Lean of the contact face towards x and y [rad].
        reach_m: Beyond this radius the image does not change.
        slope: Radial slope beyond that of the dome, at multiples of ``STEP_M``.
        curvature: Radial curvature [1/m], likewise.
        inside: 1 in contact, 0 outside, likewise.
        bulge: Height towards the camera over the unloaded gel [m], likewise.
    """

    centre: tuple[float, float]
    tilt: tuple[float, float]
    reach_m: float
    slope: SingleArray
    curvature: SingleArray
    inside: SingleArray
    bulge: SingleArray


def relief_of(profile: SurfaceProfile, *, dome_radius_m: float) -> Relief | None:
    """Return the relief of a pressed surface, or None where there is no contact."""
    if profile.depth_m <= 0.0:
        return None
    last = float(profile.radius[-1])
    radius = np.arange(0.0, last, STEP_M)
    height = np.interp(radius, profile.radius, -profile.height)
    slope = _smoothed_slope(height)
    curvature = np.gradient(slope, STEP_M)
    inside = np.clip((profile.contact_radius - radius) / (2 * STEP_M) + 0.5, 0.0, 1.0)
    extra = slope - radius / dome_radius_m * (1.0 - inside)
    changed = np.flatnonzero(np.abs(extra) > _FLAT_SLOPE)
    end = int(changed[-1]) + 2 if changed.size else 2
    reach = end * STEP_M
    fade = np.clip((reach - radius[:end]) / (0.1 * reach), 0.0, 1.0)
    return Relief(
        centre=profile.centre,
        tilt=profile.tilt,
        reach_m=reach,
        slope=_ending_in_zero(extra[:end] * fade),
        curvature=_ending_in_zero(curvature[:end] * fade),
        inside=_ending_in_zero(inside[:end]),
        bulge=_ending_in_zero((height - 0.5 * radius**2 / dome_radius_m)[:end] * fade),
    )


def looked_up(relief: Relief, table: SingleArray, x: SingleArray, y: SingleArray) -> SingleArray:
    """Return a relief's table at points of the gel, x and y from its centre [m]."""
    dx, dy = x - np.float32(relief.centre[0]), y - np.float32(relief.centre[1])
    radius = np.sqrt(dx * dx + dy * dy)
    index = np.minimum(radius * np.float32(1.0 / STEP_M), table.size - 1).astype(np.int32)
    found: SingleArray = table[index]
    return found


def _smoothed_slope(height: FloatArray) -> FloatArray:
    half = round(3 * _SMOOTHING_M / STEP_M)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * STEP_M / _SMOOTHING_M) ** 2)
    padded = np.pad(height, half, mode="reflect")
    smooth = np.convolve(padded, kernel / kernel.sum(), mode="valid")
    limited: FloatArray = np.clip(np.gradient(smooth, STEP_M), -_STEEPEST, _STEEPEST)
    return limited


def _ending_in_zero(values: FloatArray) -> SingleArray:
    return np.append(values, 0.0).astype(np.float32)
