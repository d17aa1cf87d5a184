"""Where an indenter of any shape will touch a pad, and how fine the mesh must be there.

The gel's stress is steepest under the edge of the contact where the indenter rises steeply, and
under creases of the indenter within it. Both are found from the indenter's underside alone: the
edge is where the undeformed pad and the indenter, pressed to the expected depth, overlap by a
quarter of it. That is the rim of a punch, and for a ball of radius R at depth d the circle of
radius sqrt(1.5 R d). Where the pad itself ends under the indenter there is no such edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from sim.scene.indenter import TurnedIndenter
from sim.scene.pad import Pad, covers
from tacauchy_rig.core.arrays import FloatArray, IntArray
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
    """Where a pad will be touched, in points of its undeformed top.

    Attributes:
        edge: Sharp edge of the contact and creases within it [m], shape [edge_count, 3]; none
            under a ball.
        rim: Points on the sharp edge itself, where ``edge`` has samples beside it [m], shape
            [rim_count, 3].
        inside: Points over the whole contact [m], shape [inside_count, 3].
        area_m2: Area of the contact seen from above [m^2].
    """

    edge: FloatArray
    rim: FloatArray
    inside: FloatArray
    area_m2: float

    @property
    def radius_m(self) -> float:
        """Radius of the disc of the same area [m]."""
        return float(np.sqrt(self.area_m2 / np.pi))

    def joined(self, other: Footprint) -> Footprint:
        """Return what both cover; the area is the larger one."""
        return Footprint(
            edge=np.concatenate([self.edge, other.edge]),
            rim=np.concatenate([self.rim, other.rim]),
            inside=np.concatenate([self.inside, other.inside]),
            area_m2=max(self.area_m2, other.area_m2),
        )


def footprint(
    pad: Pad, indenter: TurnedIndenter, *, centre_m: tuple[float, float], depth_m: float
) -> Footprint:
    """Return where an indenter touches a pad at a depth.

    The pad is sampled twice: under all of the indenter, then in the contact's surroundings.

    Args:
        centre_m: Where the tip stands, x and y [m].
        depth_m: Expected depth [m].

    Raises:
        ConfigError: The indenter stands beside the pad.
    """
    press = _Press(pad=pad, indenter=indenter, centre=np.array(centre_m), depth_m=depth_m)
    half = np.array(pad.half_extents())
    least, greatest = indenter.reach()
    low, high = np.maximum(-half, press.centre + least), np.minimum(half, press.centre + greatest)
    whole = press.sampled(low, high)
    margin = 2.0 * whole.spacing
    touched = whole.points[whole.touched][:, :2]
    low = np.maximum(-half, touched.min(axis=0) - margin)
    high = np.minimum(half, touched.max(axis=0) + margin)
    near = press.sampled(low, high)
    inner, outer = _sharp_pairs(near)
    on_edge = np.zeros_like(near.touched)
    on_edge[tuple(inner.T)] = True
    return Footprint(
        edge=near.points[on_edge | _creases(near)],
        rim=press.between(near, inner, outer),
        inside=near.points[near.touched],
        area_m2=float(near.touched.sum() * near.spacing.prod()),
    )


class _Samples(NamedTuple):
    """A rectangle of a pad, sampled evenly, shape [x_count, y_count, ...] each [m].

    ``underside`` is the indenter's height above its tip, inf beside it, and ``clearance`` that over
    the pad, the tip at z = 0, inf beside either: up to ``limit`` the pad will be touched.
    """

    points: FloatArray
    spacing: FloatArray
    underside: FloatArray
    clearance: FloatArray
    limit: float
    on_pad: NDArray[np.bool_]

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Which will be touched."""
        return self.clearance <= self.limit


@dataclass(frozen=True, slots=True, kw_only=True)
class _Press:
    """An indenter over a pad; ``centre`` is where its tip stands, shape [2] [m]."""

    pad: Pad
    indenter: TurnedIndenter
    centre: FloatArray
    depth_m: float

    def sampled(self, low: FloatArray, high: FloatArray) -> _Samples:
        """Sample the pad between two corners [m], shape [2] each.

        Raises:
            ConfigError: Nothing of the indenter stands over the pad.
        """
        axes = [np.linspace(a, b, _SAMPLES_ACROSS) for a, b in zip(low, high, strict=True)]
        x, y = np.meshgrid(*axes, indexing="ij")
        on_pad, top, underside = self._surfaces(x, y)
        clearance = np.where(on_pad, underside - top, np.inf)
        if np.any(low >= high) or not np.isfinite(clearance).any():
            half_x, half_y = self.pad.half_extents()
            raise ConfigError(
                f"the indenter at x = {self.centre[0] * 1e3:.4g} mm, y = "
                f"{self.centre[1] * 1e3:.4g} mm comes down beside the pad and never touches its "
                "top",
                remedy=f"move it over the pad, which reaches from {-half_x * 1e3:.4g} to "
                f"{half_x * 1e3:.4g} mm in x and from {-half_y * 1e3:.4g} to {half_y * 1e3:.4g} mm "
                "in y",
            )
        limit = float(clearance.min()) + (1.0 - _EDGE_OVERLAP) * self.depth_m
        return _Samples(
            points=np.stack([x, y, top], axis=-1),
            spacing=np.array([axis[1] - axis[0] for axis in axes]),
            underside=underside,
            clearance=clearance,
            limit=limit,
            on_pad=on_pad,
        )

    def between(self, samples: _Samples, inner: IntArray, outer: IntArray) -> FloatArray:
        """Return where the contact ends between touched and free samples, shape [count, 3] [m].

        Args:
            inner: Indices of the touched samples, shape [count, 2].
            outer: Indices of free ones beside them.
        """
        near, far = samples.points[tuple(inner.T)], samples.points[tuple(outer.T)]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (near + far)
            _, top, underside = self._surfaces(middle[:, 0], middle[:, 1])
            inside = (underside - top <= samples.limit)[:, None]
            near, far = np.where(inside, middle, near), np.where(inside, far, middle)
        _, top, _ = self._surfaces(near[:, 0], near[:, 1])
        return np.column_stack([near[:, :2], top])

    def _surfaces(
        self, x: FloatArray, y: FloatArray
    ) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
        """Return which points lie on the pad, the pad's top and the indenter's underside."""
        on_pad = covers(self.pad, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
        top = np.where(on_pad, self.pad.height_at(x, y), 0.0)
        return on_pad, top, self.indenter.lower_surface(x - self.centre[0], y - self.centre[1])


def _sharp_pairs(samples: _Samples) -> tuple[IntArray, IntArray]:
    """Return touched samples and free ones beside them that the indenter rises steeply over.

    By their indices, shape [pair_count, 2] each.
    """
    free = samples.on_pad & ~samples.touched
    inner, outer = [], []
    for axis in (0, 1):
        lower = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
        upper = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
        step = np.eye(2, dtype=np.int32)[axis]
        for here, there, along in ((lower, upper, 0), (upper, lower, 1)):
            with np.errstate(invalid="ignore"):
                rise = samples.clearance[there] - samples.clearance[here]
            steep = rise > _STEEP * samples.spacing[axis]
            found = np.argwhere(samples.touched[here] & free[there] & steep).astype(np.int32)
            inner.append(found + along * step)
            outer.append(found + (1 - along) * step)
    return np.concatenate(inner), np.concatenate(outer)


def _creases(samples: _Samples) -> NDArray[np.bool_]:
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

    Args:
        edge_m: At the contact's sharp edge [m].
        inside_m: The largest under the contact [m].
        slope: Edge length gained per length of distance from there.
        coarse_m: The largest of all [m].
    """
    edge, inside = scipy.spatial.cKDTree(touched.edge), scipy.spatial.cKDTree(touched.inside)

    def size_at(points: FloatArray) -> FloatArray:
        # Of no points at all the distance is infinite.
        size = np.minimum(
            edge_m + slope * edge.query(points)[0], inside_m + slope * inside.query(points)[0]
        )
        return np.asarray(np.minimum(size, coarse_m))

    return size_at
