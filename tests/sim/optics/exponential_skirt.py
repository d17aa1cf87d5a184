"""A gel around a ball by a formula, for presses whose true profile is to be known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.optics.calibrate.gel_profile import RadialProfile

_STEEPEST = 0.999
_SAMPLES_PER_LENGTH = 100
_LENGTHS = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentialSkirt:
    """A ball inside the contact; outside, a skirt whose tilt decays exponentially from the rim.

    Tilt is continuous at the rim, as under a smooth ball (Hertz), and dies out over a length.
    """

    ball_radius_m: float  # radius of the ball [m]
    decay_m: float  # distance over which the tilt falls by e [m]

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
        depth = height[-1] - height
        return RadialProfile(radius_m=radius, tilt=tilt, indentation_m=depth, outward_m=0.1 * depth)
