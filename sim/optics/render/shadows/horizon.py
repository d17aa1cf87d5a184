"""The highest thing over each pixel's ray to a lamp, found in one sweep towards every lamp.

Heights are sheared so that the lamp stands at the end of the columns. From there the sweep carries
the highest ray so far, lowered by what a ray sinks in a step: each pixel is visited once, however
long the shadows are. Heights between pixels are interpolated linearly across the rays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.optics.height.tilt import Float32Array

# Below everything that a ray may meet [m].
NOTHING_M = -1.0
# So many steps stay in the cache together.
_BAND_STEPS = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """How rays towards a lamp go over an image.

    Attributes:
        along_columns: A step goes one column on; else one row.
        forward: It goes towards higher columns or rows.
        shift: By how much a ray moves across in a step [px], at most 1 either way.
        step_count: Steps over the whole image.
        across: Pixels across.
    """

    along_columns: bool
    forward: bool
    shift: float
    step_count: int
    across: int

    @property
    def margin(self) -> int:
        """By how much rays move across in all [px]."""
        return math.ceil((self.step_count - 1) * abs(self.shift))

    @property
    def offset(self) -> int:
        """Number of the ray through the first pixel of the first step."""
        return self.margin + 1 if self.shift > 0.0 else 1

    @property
    def ray_count(self) -> int:
        """Rays that are followed."""
        return self.across + self.margin + 1

    @property
    def step_px(self) -> float:
        """Length of a step [px]."""
        return math.hypot(1.0, self.shift)


def sweep_towards(azimuth_rad: float, shape: tuple[int, int]) -> Sweep:
    """Return the sweep over an image of ``shape`` [height, width] towards a direction [rad]."""
    right, down = math.cos(azimuth_rad), math.sin(azimuth_rad)
    along_columns = abs(right) >= abs(down)
    ahead, aside = (right, down) if along_columns else (down, right)
    height, width = shape
    return Sweep(
        along_columns=along_columns,
        forward=ahead > 0.0,
        shift=aside / abs(ahead),
        step_count=width if along_columns else height,
        across=height if along_columns else width,
    )


@dataclass(frozen=True, slots=True)
class SweepPlaces:
    """Where rays are at each step, shapes [step_count].

    Attributes:
        whole: A ray is at its number plus this, rounded down [px].
        part: What was rounded off.
        sunk_m: How far a ray has risen since the first step [m].
    """

    whole: NDArray[np.int64]
    part: Float32Array
    sunk_m: Float32Array

    def of(self, steps: slice) -> SweepPlaces:
        """Return those of some steps."""
        return SweepPlaces(self.whole[steps], self.part[steps], self.sunk_m[steps])


def sweep_places(sweep: Sweep, rise_m: float) -> SweepPlaces:
    """Return where rays are that rise by ``rise_m`` a step [m]."""
    steps = np.arange(sweep.step_count)
    places = steps * sweep.shift - sweep.offset
    whole = np.floor(places).astype(np.int64)
    return SweepPlaces(
        whole, (places - whole).astype(np.float32), (steps * rise_m).astype(np.float32)
    )


def rise_over(bulge: Float32Array, sweep: Sweep, rise_m: float) -> Float32Array:
    """Return how far the gel rises over each pixel's ray at most [m], shape [height, width].

    Args:
        bulge: Unloaded minus loaded height [m], shape [height, width]; 0 beside the image.
        sweep: Towards the lamp.
        rise_m: By how much a ray rises in a step [m].
    """
    heights = _oriented(bulge, sweep)
    places = sweep_places(sweep, rise_m)
    over = np.empty_like(heights)
    highest = np.full(sweep.ray_count, NOTHING_M, dtype=np.float32)
    for start in reversed(range(0, sweep.step_count, _BAND_STEPS)):
        steps = slice(start, min(start + _BAND_STEPS, sweep.step_count))
        _sweep_band(heights[steps], places.of(steps), sweep, highest, over[steps])
    return _oriented_back(over, sweep)


def _sweep_band(
    heights: Float32Array,
    places: SweepPlaces,
    sweep: Sweep,
    highest: Float32Array,
    over: Float32Array,
) -> None:
    """Carry the highest ray so far over a band of steps, and say what rises over its pixels."""
    part, sunk = places.part[:, None], places.sunk_m[:, None]
    across, room, rays = sweep.across, sweep.margin + 1, sweep.ray_count
    passed = np.empty((len(heights), across + 2 * room), dtype=np.float32)
    passed[...] = -sunk
    rest = 1.0 - part
    passed[:, room - 1 : room + across - 1] += part * heights
    passed[:, room : room + across] += rest * heights
    seen = np.empty((len(heights), across + 1), dtype=np.float32)
    # A ray's pixel lies at its number plus ``whole`` and ``part``.
    for step, first in reversed(list(enumerate(places.whole.tolist()))):
        seen[step] = highest[-first - 1 : across - first]
        np.maximum(highest, passed[step, first + room : first + room + rays], out=highest)
    np.multiply(part, seen[:, :-1], out=over)
    seen[:, 1:] *= rest
    over += seen[:, 1:]
    over -= heights
    over += sunk


def _oriented(image: Float32Array, sweep: Sweep) -> Float32Array:
    """Return the image with steps along its first axis, the lamp at their end."""
    turned = image.T if sweep.along_columns else image
    return np.ascontiguousarray(turned if sweep.forward else turned[::-1])


def _oriented_back(image: Float32Array, sweep: Sweep) -> Float32Array:
    turned = image if sweep.forward else image[::-1]
    return turned.T if sweep.along_columns else turned
