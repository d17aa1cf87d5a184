"""Where an indenter of any shape will touch a pad, and how fine the mesh must be there.

Stress is steepest under the contact's edge, where the indenter rises steeply, and under creases
within it. The edge is where the undeformed pad and the indenter, pressed to the expected depth,
overlap by a quarter of it: the rim of a punch, and for a ball of radius R at depth d the circle of
radius sqrt(1.5 R d). Where the pad itself ends under the indenter there is no such edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from sim.scene.indenter import TurnedIndenter
from sim.scene.pad import Pad, covers
from tacauchy_rig.core.arrays import BoolArray, FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

# Overlap of the undeformed pad and the indenter at the contact's edge, over the expected depth.
_EDGE_OVERLAP = 0.25
# Change of the underside's slope from one sample to the next that makes a crease.
_CREASE_SLOPE = 0.35
# Slope of the clearance at the contact's edge from which the edge is a sharp one.
_STEEP = 0.5
_SAMPLES_ACROSS = 160
# The rim lies between two samples to their distance over 2^30.
_BISECTIONS = 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint:
    """Where a pad will be touched, in points of its undeformed top."""

    # Sharp edge of the contact and creases within it [m], shape [edge_count, 3]; none under a ball
    edge: FloatArray
    # Points on the sharp edge itself; ``edge`` has samples beside it [m], shape [rim_count, 3]
    rim: FloatArray
    inside: FloatArray  # points over the whole contact [m], shape [inside_count, 3]
    area_m2: float  # area of the contact seen from above [m^2]

    @property
    def radius_m(self) -> float:
        """Radius of the disc of the same area [m]."""
        return float(np.sqrt(self.area_m2 / np.pi))

    def joined(self, other: Footprint) -> Footprint:
        """Return what both cover; the area is the larger one."""
        pairs = (self.edge, other.edge), (self.rim, other.rim), (self.inside, other.inside)
        edge, rim, inside = (np.concatenate(pair) for pair in pairs)
        return Footprint(
            edge=edge, rim=rim, inside=inside, area_m2=max(self.area_m2, other.area_m2)
        )


def footprint(
    pad: Pad, indenter: TurnedIndenter, *, centre_m: tuple[float, float], depth_m: float
) -> Footprint:
    """Return where an indenter, its tip at ``centre_m`` in x and y, touches a pad at a depth.

    The pad is sampled twice: under all of the indenter, then in the contact's surroundings.

    Raises:
        ConfigError: The indenter stands beside the pad.
    """
    press = _Press(pad=pad, indenter=indenter, centre=np.array(centre_m))
    half = np.array(pad.half_extents())
    least, greatest = indenter.reach()
    low, high = np.maximum(-half, press.centre + least), np.minimum(half, press.centre + greatest)
    whole = _Samples(press, low, high, depth_m=depth_m)
    margin, touched = 2.0 * whole.spacing, whole.points[whole.touched][:, :2]
    low = np.maximum(-half, touched.min(axis=0) - margin)
    high = np.minimum(half, touched.max(axis=0) + margin)
    near = _Samples(press, low, high, depth_m=depth_m)
    inner, outer = _sharp_pairs(near)
    on_edge = np.zeros_like(near.touched)
    on_edge[tuple(inner)] = True
    return Footprint(
        edge=near.points[on_edge | _creases(near)],
        rim=_on_rim(press, near, inner, outer),
        inside=near.points[near.touched],
        area_m2=float(near.touched.sum() * near.spacing.prod()),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Press:
    """An indenter over a pad; ``centre`` is where its tip stands, shape [2] [m]."""

    pad: Pad
    indenter: TurnedIndenter
    centre: FloatArray

    def surfaces(self, x: FloatArray, y: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Return which points lie on the pad, the pad's top and the indenter's underside."""
        on_pad = covers(self.pad, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
        top = np.where(on_pad, self.pad.height_at(x, y), 0.0)
        return on_pad, top, self.indenter.lower_surface(x - self.centre[0], y - self.centre[1])


class _Samples:
    """A rectangle of a pad between two corners [m], sampled evenly, shape [x_count, y_count, ...].

    Attributes:
        limit: Clearance up to which the pad will be touched [m].
    """

    def __init__(self, press: _Press, low: FloatArray, high: FloatArray, *, depth_m: float) -> None:
        axes = [np.linspace(a, b, _SAMPLES_ACROSS) for a, b in zip(low, high, strict=True)]
        x, y = np.meshgrid(*axes, indexing="ij")
        self.on_pad, top, self.underside = press.surfaces(x, y)
        # The indenter's height over the pad, its tip at z = 0; inf beside either.
        self.clearance = np.where(self.on_pad, self.underside - top, np.inf)
        if np.any(low >= high) or not np.isfinite(self.clearance).any():
            half_x, half_y = (1e3 * each for each in press.pad.half_extents())
            at_x, at_y = 1e3 * press.centre
            raise ConfigError(
                f"the indenter at x = {at_x:.4g} mm, y = {at_y:.4g} mm comes down beside the pad "
                "and never touches its top",
                remedy=f"move it over the pad, which reaches from {-half_x:.4g} to {half_x:.4g} mm "
                f"in x and from {-half_y:.4g} to {half_y:.4g} mm in y",
            )
        self.limit = float(self.clearance.min()) + (1.0 - _EDGE_OVERLAP) * depth_m
        self.touched = self.clearance <= self.limit
        self.points = np.stack([x, y, top], axis=-1)
        self.spacing = np.array([axis[1] - axis[0] for axis in axes])


def _on_rim(press: _Press, samples: _Samples, inner: IntArray, outer: IntArray) -> FloatArray:
    """Return where the contact ends between touched samples and free ones, [count, 3] [m]."""
    near, far = samples.points[tuple(inner)], samples.points[tuple(outer)]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (near + far)
        _, top, underside = press.surfaces(middle[:, 0], middle[:, 1])
        inside = (underside - top <= samples.limit)[:, None]
        near, far = np.where(inside, middle, near), np.where(inside, far, middle)
    _, top, _ = press.surfaces(near[:, 0], near[:, 1])
    return np.column_stack([near[:, :2], top])


def _sharp_pairs(samples: _Samples) -> tuple[IntArray, IntArray]:
    """Return indices of touched samples and of free ones beside them that it rises steeply over."""
    free, touched = samples.on_pad & ~samples.touched, np.argwhere(samples.touched)
    pairs = []
    for axis, step in ((0, (1, 0)), (0, (-1, 0)), (1, (0, 1)), (1, (0, -1))):
        beside = touched + step
        inside = np.all((beside >= 0) & (beside < _SAMPLES_ACROSS), axis=1)
        here, there = touched[inside].T, beside[inside].T
        rise = samples.clearance[tuple(there)] - samples.clearance[tuple(here)]
        sharp = free[tuple(there)] & (rise > _STEEP * samples.spacing[axis])
        pairs.append(np.stack([here[:, sharp], there[:, sharp]]))
    inner, outer = np.concatenate(pairs, axis=2)
    return inner, outer


def _creases(samples: _Samples) -> BoolArray:
    """Return the touched samples across which the underside's slope changes abruptly."""
    found = np.zeros_like(samples.touched)
    with np.errstate(invalid="ignore"):
        for axis, inner in enumerate(((slice(1, -1), slice(None)), (slice(None), slice(1, -1)))):
            change = np.abs(np.diff(samples.underside, n=2, axis=axis)) / samples.spacing[axis]
            found[inner] |= np.isfinite(change) & (change > _CREASE_SLOPE)
    return found & samples.touched


def sizing_field(
    touched: Footprint, *, edge_m: float, inside_m: float, slope: float, coarse_m: float
) -> Callable[[FloatArray], FloatArray]:
    """Return the target edge length [m] by points [m], shape [count, 3].

    At the contact's sharp edge and at most under the contact; ``slope`` is gained per length of
    distance from there, up to the coarse one.
    """
    edge, inside = scipy.spatial.cKDTree(touched.edge), scipy.spatial.cKDTree(touched.inside)

    def size_at(points: FloatArray) -> FloatArray:
        # Of no points at all the distance is infinite.
        size = np.minimum(
            edge_m + slope * edge.query(points)[0], inside_m + slope * inside.query(points)[0]
        )
        return np.asarray(np.minimum(size, coarse_m))

    return size_at
