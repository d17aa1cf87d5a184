"""Shadows written out in NumPy, step by step, as a reference for the kernels."""

from __future__ import annotations

import math

import numpy as np

from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import Lamp, ShadowCaster

_NOTHING_M = -1.0


def plain_darkening(
    shadows: ShadowCaster, bulge: np.ndarray, tilt: np.ndarray, geometry: CameraGeometry
) -> np.ndarray:
    """Return the light taken away [grey levels, not positive], shape [3, height, width]."""
    taken = np.zeros((3, *bulge.shape))
    for lamp in shadows.lamps:
        over = _rise_over(bulge, lamp, geometry)
        along, across, up = lamp.towards
        facing = along * tilt[0] + across * tilt[1] + up * np.sqrt(1 - tilt[0] ** 2 - tilt[1] ** 2)
        share = np.clip(over / shadows.softness_m, 0.0, 1.0) * np.maximum(facing, 0.0)
        taken -= np.array(lamp.colour)[:, None, None] * share
    return taken


def _rise_over(bulge: np.ndarray, lamp: Lamp, geometry: CameraGeometry) -> np.ndarray:
    """Return how far the gel rises over each pixel's ray at most [m], shape [height, width]."""
    right, down = math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)
    turned = abs(right) >= abs(down)
    ahead, aside = (right, down) if turned else (down, right)
    heights = bulge.T if turned else bulge
    heights = heights if ahead > 0.0 else heights[::-1]
    steps, across = heights.shape
    shift = aside / abs(ahead)
    rise_m = math.tan(lamp.elevation_rad) * geometry.mean_scale_m * math.hypot(1.0, shift)
    margin = math.ceil((steps - 1) * abs(shift))
    offset = margin + 1 if shift > 0.0 else 1
    highest = np.full(across + margin + 1, _NOTHING_M)
    rays = np.arange(len(highest))
    over = np.empty_like(heights)
    for step in reversed(range(steps)):
        place = step * shift - offset
        whole, sunk = math.floor(place), step * rise_m
        part = place - whole
        between = np.arange(across) - whole
        seen = part * highest[between - 1] + (1.0 - part) * highest[between]
        over[step] = seen + sunk - heights[step]
        met = np.interp(rays + place, np.arange(-1, across + 1), [0.0, *heights[step], 0.0])
        highest = np.maximum(highest, met - sunk)
    over = over if ahead > 0.0 else over[::-1]
    return over.T if turned else over
