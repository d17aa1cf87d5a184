"""Shape of the gel around a pressed ball, as a function of the contact's radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.arrays import FloatArray


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
    """The gel around a ball of one size on one gel."""

    def __call__(self, contact_radius_m: float) -> RadialProfile:
        """Return the gel's surface where the contact has this radius [m]."""
        ...
