"""Where an indenter of any shape will touch a pad, and how fine the mesh must be there.

The gel's stress is steepest under the edge of the contact where the indenter rises steeply, and
under creases of the indenter within it. Both are found from the indenter's underside alone: the
edge is where the undeformed pad and the indenter, pressed to the expected depth, overlap by a
quarter of it. That is the rim of a punch, and for a ball of radius R at depth d the circle of
radius sqrt(1.5 R d). Where the pad itself ends under the indenter there is no such edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.pad import Pad
from sim.turned_indenter import TurnedIndenter
from tacauchy_rig.errors import ConfigError

_EDGE_OVERLAP = 0.25
_CREASE_SLOPE = 0.35
_STEEP = 0.5
_SAMPLES_ACROSS = 160


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint:
    """Where a pad will be touched, in points of its undeformed top.

    Attributes:
        edge: Sharp edge of the contact and creases within it [m], shape [edge_count, 3]; none
            under a ball.
        inside: Points over the whole contact [m], shape [inside_count, 3].
        area_m2: Area of the contact seen from above [m^2].
    """

    edge: FloatArray
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
    half, centre = np.array(pad.half_extents()), np.array(centre_m)
    least, greatest = indenter.reach()
    low, high = np.maximum(-half, centre + least), np.minimum(half, centre + greatest)
    whole = _sampled(pad, indenter, centre_m, depth_m, low, high)
    margin = 2.0 * whole.spacing
    touched = whole.points[whole.touched][:, :2]
    low = np.maximum(-half, touched.min(axis=0) - margin)
    high = np.minimum(half, touched.max(axis=0) + margin)
    near = _sampled(pad, indenter, centre_m, depth_m, low, high)
    return Footprint(
        edge=near.points[_sharp_outline(near) | _creases(near)],
        inside=near.points[near.touched],
        area_m2=float(near.touched.sum() * near.spacing.prod()),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Samples:
    """A rectangle of a pad, sampled evenly; shapes begin with [x_count, y_count].

    Attributes:
        points: Points of the top [m], shape [..., 3].
        spacing: Between samples along x and y [m], shape [2].
        underside: Height of the indenter above its tip [m], inf beside it.
        clearance: Height of the indenter over the pad, its tip at z = 0 [m]; inf beside either.
        on_pad: Which samples lie on the pad.
        touched: Which will be touched.
    """

    points: FloatArray
    spacing: FloatArray
    underside: FloatArray
    clearance: FloatArray
    on_pad: NDArray[np.bool_]
    touched: NDArray[np.bool_]


def _sampled(
    pad: Pad,
    indenter: TurnedIndenter,
    centre_m: tuple[float, float],
    depth_m: float,
    low: FloatArray,
    high: FloatArray,
) -> _Samples:
    if np.any(low >= high):
        raise _beside(pad, centre_m)
    axes = [np.linspace(a, b, _SAMPLES_ACROSS) for a, b in zip(low, high, strict=True)]
    x, y = np.meshgrid(*axes, indexing="ij")
    on_pad = pad.covers(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    underside = indenter.lower_surface(x - centre_m[0], y - centre_m[1])
    top = np.where(on_pad, pad.height_at(x, y), 0.0)
    clearance = np.where(on_pad, underside - top, np.inf)
    if not np.isfinite(clearance).any():
        raise _beside(pad, centre_m)
    return _Samples(
        points=np.stack([x, y, top], axis=-1),
        spacing=np.array([axis[1] - axis[0] for axis in axes]),
        underside=underside,
        clearance=clearance,
        on_pad=on_pad,
        touched=clearance - clearance.min() <= (1.0 - _EDGE_OVERLAP) * depth_m,
    )


def _beside(pad: Pad, centre_m: tuple[float, float]) -> ConfigError:
    x, y = centre_m
    half_x, half_y = pad.half_extents()
    return ConfigError(
        f"the indenter at x = {x * 1e3:.4g} mm, y = {y * 1e3:.4g} mm comes down beside the pad and "
        "never touches its top",
        remedy=f"move it over the pad, which reaches from {-half_x * 1e3:.4g} to "
        f"{half_x * 1e3:.4g} mm in x and from {-half_y * 1e3:.4g} to {half_y * 1e3:.4g} mm in y",
    )


def _sharp_outline(samples: _Samples) -> NDArray[np.bool_]:
    """Return the touched samples beside others of the pad that the indenter rises steeply over."""
    found = np.zeros_like(samples.touched)
    for axis in (0, 1):
        for step in (1, -1):
            beside = np.roll(samples.clearance, -step, axis=axis)
            free = np.roll(samples.on_pad & ~samples.touched, -step, axis=axis)
            # What is rolled in from the other side is no neighbour.
            free[tuple(slice(None) if k != axis else (-1 if step == 1 else 0) for k in (0, 1))] = (
                False
            )
            with np.errstate(invalid="ignore"):
                rise = beside - samples.clearance
            found |= samples.touched & free & (rise > _STEEP * samples.spacing[axis])
    return found


def _creases(samples: _Samples) -> NDArray[np.bool_]:
    """Return the touched samples across which the underside's slope changes abruptly."""
    found = np.zeros_like(samples.touched)
    with np.errstate(invalid="ignore"):
        for axis, inner in enumerate(((slice(1, -1), slice(None)), (slice(None), slice(1, -1)))):
            change = np.abs(np.diff(samples.underside, n=2, axis=axis)) / samples.spacing[axis]
            found[inner] |= np.isfinite(change) & (change > _CREASE_SLOPE)
    return found & samples.touched
