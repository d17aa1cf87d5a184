"""Exact shear under a rigid body that is pressed into a half space without friction, then moved.

Slip begins at the contact's edge and leaves a circle of radius c that sticks. Outside of it the
shear is mu p; inside something is taken off that (p0 = p(0), a the contact's radius):

    carried along x (Cattaneo 1938, Mindlin 1949), of a ball:  mu p0 c / a sqrt(1 - r^2 / c^2)
    turned about its axis (a ball: Lubkin 1951):  2 mu / pi int_0^acos(r/c) g(r / cos u) du

Turned, shear and normal contact are apart for every Poisson's ratio. With the shear's own Abel
transform, as Reissner and Sagoci's (1944), g(t) = -t d/dt I, I(t) = int_t^a p / sqrt(r^2 - t^2) dr,
and the turn is beta = mu I(c) / (2 G). For a ball I = p0 (K - E) and g = p0 E, complete elliptic
integrals of m = 1 - t^2 / a^2; for a flat punch I = F K / (2 pi a^2) and
g = F (E - (1 - m) K) / (2 pi a^2 m). Carried, both are apart where nu is 0.5.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.optimize
import scipy.special

from tacauchy_rig.core.arrays import FloatArray

_GAUSS_COUNT = 64
# Of the contact's radius: a narrower stuck circle is none.
_NARROWEST = 1e-9


def carried_ball_shear(
    radii_m: FloatArray, *, friction: float, pressure_pa: float, contact_m: float, held: float
) -> FloatArray:
    """Return the shear along the way that a ball is carried [Pa].

    Args:
        pressure_pa: p0, at the middle [Pa].
        contact_m: a [m].
        held: Tangential over the largest tangential force, Q / (mu F).
    """
    stuck_m = contact_m * (1.0 - held) ** (1.0 / 3.0)
    inner = stuck_m / contact_m * _dome(radii_m, stuck_m)
    return np.asarray(friction * pressure_pa * (_dome(radii_m, contact_m) - inner))


def turned_ball_shear(
    radii_m: FloatArray,
    *,
    friction: float,
    pressure_pa: float,
    contact_m: float,
    shear_strain_pa: float,
) -> FloatArray:
    """Return the shear around the axis of a ball that is turned [Pa].

    Args:
        shear_strain_pa: 2 G beta [Pa], beta the turn [rad].
    """

    def at(radii: FloatArray) -> FloatArray:
        return 1.0 - (radii / contact_m) ** 2

    def held_pa(radius_m: float) -> float:
        m = float(at(np.array(radius_m)))
        return pressure_pa * float(scipy.special.ellipk(m) - scipy.special.ellipe(m))

    stuck = _stuck(held_pa, contact_m, shear_strain_pa / friction)
    relief = _relief(radii_m, stuck, lambda t: pressure_pa * scipy.special.ellipe(at(t)))
    return friction * (pressure_pa * _dome(radii_m, contact_m) - relief)


def turned_punch_shear(
    radii_m: FloatArray,
    *,
    friction: float,
    force_n: float,
    radius_m: float,
    shear_strain_pa: float,
) -> FloatArray:
    """Return the shear around the axis of a flat punch that is turned [Pa], inside its rim.

    Args:
        shear_strain_pa: 2 G beta [Pa], beta the turn [rad].
    """
    scale = force_n / (2.0 * np.pi * radius_m**2)

    def at(radii: FloatArray) -> FloatArray:
        return 1.0 - (radii / radius_m) ** 2

    def held_pa(radius: float) -> float:
        return scale * float(scipy.special.ellipk(float(at(np.array(radius)))))

    def slope(radii: FloatArray) -> FloatArray:
        m = at(radii)
        parts = scipy.special.ellipe(m) - (1.0 - m) * scipy.special.ellipk(m)
        return np.asarray(scale * parts / m)

    stuck = _stuck(held_pa, radius_m, shear_strain_pa / friction)
    pressure = scale / np.sqrt(at(radii_m))
    return friction * (pressure - _relief(radii_m, stuck, slope))


def _dome(radii_m: FloatArray, reach_m: float) -> FloatArray:
    """Return sqrt(1 - r^2 / c^2) inside a circle, zero beside it."""
    inside = radii_m < reach_m
    return np.sqrt(np.where(inside, 1.0 - (radii_m / max(reach_m, radii_m.min())) ** 2, 0.0))


def _stuck(held_pa: Callable[[float], float], contact_m: float, wanted_pa: float) -> float:
    """Return the radius of the circle that sticks [m]: I falls towards the edge."""
    least, most = _NARROWEST * contact_m, (1.0 - _NARROWEST) * contact_m
    return float(scipy.optimize.brentq(lambda c: held_pa(c) - wanted_pa, least, most))


def _relief(
    radii_m: FloatArray, stuck_m: float, slope: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Return 2 / pi int_0^acos(r/c) g(r / cos u) du inside the circle that sticks [Pa]."""
    at, weights = np.polynomial.legendre.leggauss(_GAUSS_COUNT)
    widest = np.arccos(np.minimum(radii_m / stuck_m, 1.0))[:, None]
    angles = 0.5 * widest * (at + 1.0)
    values = slope(radii_m[:, None] / np.cos(angles)) * 0.5 * widest
    return np.asarray(2.0 / np.pi * values @ weights)
