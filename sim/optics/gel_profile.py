"""Shape of the gel around a pressed ball, as a function of the contact's radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.arrays import FloatArray

_STEEPEST = 0.999
_SAMPLES_PER_LENGTH = 100
_LENGTHS = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RadialProfile:
    """Axisymmetric gel surface.

    Attributes:
        radius_m: Ascending distances from the ball's axis [m], shape [sample_count].
        tilt: Sine of the surface's angle, positive where it rises outwards, same shape.
        indentation_m: Unloaded minus loaded height [m], same shape.
    """

    radius_m: FloatArray
    tilt: FloatArray
    indentation_m: FloatArray

    def curvature(self, radius_m: FloatArray, *, width_m: float) -> FloatArray:
        """Return the divergence of the tilt [1/m], averaged over ``width_m`` along the radius.

        The flux of the tilt through a circle is what the divergence inside it amounts to, so that
        a sharp bend counts whole however narrow it is.

        Args:
            radius_m: Distances from the axis [m], any shape.
            width_m: What a pixel sees of the gel [m].
        """
        outer = radius_m + 0.5 * width_m
        inner = np.maximum(radius_m - 0.5 * width_m, 0.0)
        flux = [r * np.interp(r, self.radius_m, self.tilt, right=0.0) for r in (outer, inner)]
        return np.asarray(2.0 * (flux[0] - flux[1]) / (outer**2 - inner**2))


class GelProfile(Protocol):
    """The gel around a ball of one size on one gel, from a formula or from the simulator."""

    def __call__(self, contact_radius_m: float) -> RadialProfile:
        """Return the gel's surface where the contact has this radius [m]."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentialSkirt:
    """A ball inside the contact; outside, a skirt whose tilt decays exponentially from the rim.

    A stand-in until the simulator's profile is given: tilt is continuous at the rim, as under a
    smooth ball (Hertz), and dies out over a fixed length.

    Attributes:
        ball_radius_m: Radius of the ball [m].
        decay_m: Distance over which the tilt falls by e [m].
    """

    ball_radius_m: float
    decay_m: float

    def __call__(self, contact_radius_m: float) -> RadialProfile:
        """Return the gel's surface where the contact has this radius [m]."""
        rim_radius = min(contact_radius_m, _STEEPEST * self.ball_radius_m)
        reach = rim_radius + _LENGTHS * self.decay_m
        step = min(rim_radius, self.decay_m) / _SAMPLES_PER_LENGTH
        radius = np.linspace(0.0, reach, max(2, round(reach / step)))
        beyond = np.maximum(radius - rim_radius, 0.0)
        tilt = np.minimum(radius, rim_radius) / self.ball_radius_m * np.exp(-beyond / self.decay_m)
        slope = tilt / np.sqrt(1.0 - tilt**2)
        rise = 0.5 * (slope[1:] + slope[:-1]) * np.diff(radius)
        height = np.concatenate([[0.0], np.cumsum(rise)])
        return RadialProfile(radius_m=radius, tilt=tilt, indentation_m=height[-1] - height)
