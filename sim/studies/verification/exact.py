"""Exact small-strain solutions that presses have to meet: elastic layers, shear with friction.

**Layers.** A frictionless punch or ball of contact radius a on layers bonded to a rigid base has
F = 2 a E / (1 - nu^2) int_0^1 phi, with E and nu of the uppermost layer (Hayes et al. 1972 for one
layer). In Lebedev and Ufliand's reduction of the dual integral equations phi is even and solves, on
[-1, 1],

    phi(x) - a / pi int K(a (x - t)) phi(t) dt = f(x),     K(u) = int_0^inf (1 - L(k)) cos(k u) dk,

where L is the layers' compliance to a wave of wave number k, relative to a half space's. A flat
punch has f = d; a ball has f = d - a^2 x^2 / R, and a is where phi(1) = 0. The pressure is

    p(r) = E / ((1 - nu^2) pi a) (phi(1) / sqrt(1 - x^2) - int_x^1 phi'(t) / sqrt(t^2 - x^2) dt),

with x = r / a. For L each layer is integrated in Hankel space. With u_r = U J1(kr), u_z = W J0(kr),
tau_rz = T J1(kr) and sigma_zz = S J0(kr), equilibrium and Hooke's law are

    U' = k W + T / mu          T' = k ((lambda + 2 mu) k U + lambda W')
    W' = (S - lambda k U) / (lambda + 2 mu)                         S' = -k T

The stiffness of all that lies below, (T, S) = K (U, W), is carried up from the clamped base in thin
slices, where the exponentials stay small. At the surface W = C(k) S, and
L(k) = C k E / (2 (1 - nu^2)) tends to 1 for short waves.

**Shear.** Under a rigid body that is pressed into a half space without friction and then moved,
slip begins at the contact's edge and leaves a circle of radius c that sticks. Outside of it the
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

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.special

from sim.scene.material import Layer
from sim.scene.scene import Scene
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# Beyond this wave number times the top layer's thickness, L is 1 to 1e-17 of what it may reach.
_WAVE_NUMBER_MAX = 24.0
# Gauss points over wave numbers and over the contact: four digits more than a page shows.
_WAVE_COUNT = 800
_POINT_COUNT = 160
# Of the polynomial whose derivative is taken for phi's, which is smooth and even.
_PHI_DEGREE = 24


class Ply(NamedTuple):
    """A layer by its elastic constants; nu may be 0.5."""

    young_pa: float
    poisson: float
    thickness_m: float


class BondedLayers:
    """Layers of infinite extent on a rigid base.

    Args:
        plies: From the base to the surface.
    """

    def __init__(self, plies: Sequence[Ply]) -> None:
        if not plies:
            raise ConfigError("a laminate of no layers", remedy="give at least one layer")
        top = plies[-1]
        self._modulus_pa = top.young_pa / (1.0 - top.poisson**2)
        at, weight = np.polynomial.legendre.leggauss(_WAVE_COUNT)
        half = 0.5 * _WAVE_NUMBER_MAX / top.thickness_m
        self._waves = half * (at + 1.0)
        self._missing = half * weight * (1.0 - surface_compliance(plies, self._waves))

    @classmethod
    def of_scene(cls, scene: Scene) -> BondedLayers:
        """Return the layers of a scene's pad, or its one gel."""
        layers = scene.layers or (Layer(share=1.0, material=scene.material),)
        gels = [(layer.material, layer.share * scene.pad.height_m) for layer in layers]
        return cls([Ply(gel.young_pa, gel.poisson, thickness) for gel, thickness in gels])

    def punch_factor(self, radius_m: float) -> float:
        """Return kappa = F (1 - nu^2) / (2 a E d) of a flat punch; 1 on a half space."""
        return self._density(radius_m, 1.0).mean()

    def punch_force(self, *, radius_m: float, depth_m: float) -> float:
        """Return the force of a frictionless flat punch [N]."""
        return 2.0 * radius_m * self._modulus_pa * depth_m * self.punch_factor(radius_m)

    def ball_force(self, *, radius_m: float, depth_m: float) -> tuple[float, float]:
        """Return a frictionless ball's force [N] and contact radius [m].

        The ball is the paraboloid of its radius, as in Hertz's theory.
        """

        def density(contact_m: float) -> _Density:
            return self._density(contact_m, depth_m, contact_m**2 / radius_m)

        widest = math.sqrt(2.0 * radius_m * depth_m)
        edges = 0.1 * widest, 2.0 * widest
        contact = float(scipy.optimize.brentq(lambda contact_m: density(contact_m).rim, *edges))
        return 2.0 * contact * self._modulus_pa * density(contact).mean(), contact

    def punch_pressure(self, radii_m: FloatArray, *, radius_m: float, depth_m: float) -> FloatArray:
        """Return a flat punch's pressure [Pa] at radii below its own; singular at the rim."""
        phi = self._density(radius_m, depth_m)
        return self._modulus_pa * phi.pressure(radii_m / radius_m) / radius_m

    def ball_pressure(self, radii_m: FloatArray, *, radius_m: float, depth_m: float) -> FloatArray:
        """Return a ball's pressure [Pa] at radii from its axis, zero beside the contact."""
        _, contact = self.ball_force(radius_m=radius_m, depth_m=depth_m)
        phi, inside = self._density(contact, depth_m, contact**2 / radius_m), radii_m < contact
        pressure = np.zeros_like(radii_m)
        pressure[inside] = self._modulus_pa * phi.pressure(radii_m[inside] / contact) / contact
        return pressure

    def _density(self, radius_m: float, flat: float, curved: float = 0.0) -> _Density:
        return _Density(radius_m, flat, curved, self._waves, self._missing)


def radius_m(scene: Scene) -> float:
    """Return the radius of a scene's ball or cylinder [m]."""
    return float(getattr(scene.indenter, "radius_m"))  # noqa: B009 - others have none


def hertz_force(*, radius_m: float, depth_m: float, young_pa: float, poisson: float) -> float:
    """Return Hertz's force of a ball on a half space [N]: 4/3 E / (1 - nu^2) sqrt(R) d^1.5."""
    return 4.0 / 3.0 * young_pa / (1.0 - poisson**2) * math.sqrt(radius_m * depth_m) * depth_m


class _Density:
    """phi for f = flat - curved x^2, by Nystroem's method on Gauss points.

    Args:
        radius_m: a [m].
        waves: Wave numbers [1/m], shape [wave_count].
        missing: 1 - L there, times the weight of each in an integral [1/m].

    Attributes:
        rim: phi(1).
    """

    def __init__(
        self, radius_m: float, flat: float, curved: float, waves: FloatArray, missing: FloatArray
    ) -> None:
        self._points, self._weights = np.polynomial.legendre.leggauss(_POINT_COUNT)
        places = np.append(self._points, 1.0)
        angles, wanted = np.outer(waves, radius_m * places), flat - curved * places**2
        even, odd = np.cos(angles), np.sin(angles)
        kernel = even.T @ (missing[:, None] * even) + odd.T @ (missing[:, None] * odd)
        coupling = radius_m / math.pi * kernel[:, :-1] * self._weights
        self._values = np.linalg.solve(np.eye(_POINT_COUNT) - coupling[:-1], wanted[:-1])
        self.rim = float(wanted[-1] + coupling[-1] @ self._values)

    def mean(self) -> float:
        """Return int_0^1 phi."""
        return 0.5 * float(self._weights @ self._values)

    def pressure(self, places: FloatArray) -> FloatArray:
        """Return a p (1 - nu^2) / E at x < 1, with t^2 = x^2 + (1 - x^2) sin^2."""
        slope = np.polynomial.chebyshev.chebder(
            np.polynomial.chebyshev.chebfit(self._points, self._values, _PHI_DEGREE)
        )
        angles = 0.25 * np.pi * (self._points + 1.0)
        short = np.sqrt(1.0 - places**2)[:, None]
        at = np.sqrt(places[:, None] ** 2 + (short * np.sin(angles)) ** 2)
        integrand = np.polynomial.chebyshev.chebval(at, slope) * short * np.cos(angles) / at
        inner = 0.25 * np.pi * integrand @ self._weights
        return np.asarray((self.rim / short[:, 0] - inner) / np.pi)


def surface_compliance(plies: Sequence[Ply], waves: FloatArray) -> FloatArray:
    """Return L at wave numbers [1/m]: 0 for long waves, 1 for short ones."""
    stiffness: FloatArray = np.empty(0)
    for ply in plies:
        slices = max(4, math.ceil(waves.max() * ply.thickness_m))
        step = scipy.linalg.expm(_system(ply, waves) * (ply.thickness_m / slices))
        kept, forced = step[:, :2, :2], step[:, :2, 2:]
        raised, carried = step[:, 2:, :2], step[:, 2:, 2:]
        for _ in range(slices):
            if not stiffness.size:
                stiffness = carried @ np.linalg.inv(forced)
            else:
                motion = kept + forced @ stiffness
                stiffness = (raised + carried @ stiffness) @ np.linalg.inv(motion)
    compliance = np.linalg.inv(stiffness)[:, 1, 1]
    top = plies[-1]
    return np.asarray(compliance * waves * top.young_pa / (2.0 * (1.0 - top.poisson**2)))


def _system(ply: Ply, waves: FloatArray) -> FloatArray:
    """Return d/dz of (U, W, T, S) for every wave number, shape [wave_count, 4, 4]."""
    nu = ply.poisson
    mu = ply.young_pa / (2.0 * (1.0 + nu))
    system = np.zeros((len(waves), 4, 4))
    system[:, 0, 1], system[:, 0, 2] = waves, 1.0 / mu
    # lambda / (lambda + 2 mu) and 1 / (lambda + 2 mu), which are finite at nu = 0.5.
    system[:, 1, 0] = -waves * nu / (1.0 - nu)
    system[:, 1, 3] = (1.0 - 2.0 * nu) / (2.0 * mu * (1.0 - nu))
    system[:, 2, 0] = waves**2 * 2.0 * mu / (1.0 - nu)
    system[:, 2, 3] = waves * nu / (1.0 - nu)
    system[:, 3, 2] = -waves
    return system


_GAUSS_COUNT = 64
# Of the contact's radius: a narrower stuck circle is none.
_NARROWEST = 1e-9


def carried_ball_shear(
    radii_m: FloatArray, *, friction: float, pressure_pa: float, contact_m: float, held: float
) -> FloatArray:
    """Return the shear along the way that a ball is carried [Pa]; ``held`` is Q / (mu F)."""
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
    """Return the shear around the axis of a ball that is turned [Pa], of 2 G beta [Pa]."""

    def at(radii: Any) -> Any:
        return 1.0 - (radii / contact_m) ** 2

    def held_pa(radius_m: float) -> float:
        m = at(radius_m)
        return float(pressure_pa * (scipy.special.ellipk(m) - scipy.special.ellipe(m)))

    stuck = _stuck(held_pa, contact_m, shear_strain_pa / friction)
    relief = _relief(radii_m, stuck, lambda t: pressure_pa * scipy.special.ellipe(at(t)))
    return friction * (pressure_pa * _dome(radii_m, contact_m) - relief)


def turned_punch_shear(
    radii_m: FloatArray, *, friction: float, force_n: float, radius_m: float, shear_strain_pa: float
) -> FloatArray:
    """Return the shear around the axis of a flat punch that is turned [Pa], inside its rim."""
    scale = force_n / (2.0 * np.pi * radius_m**2)

    def at(radii: Any) -> Any:
        return 1.0 - (radii / radius_m) ** 2

    def slope(radii: FloatArray) -> FloatArray:
        m = at(radii)
        parts = scipy.special.ellipe(m) - (1.0 - m) * scipy.special.ellipk(m)
        return np.asarray(scale * parts / m)

    wanted = shear_strain_pa / friction
    stuck = _stuck(lambda c: scale * float(scipy.special.ellipk(at(c))), radius_m, wanted)
    relief = _relief(radii_m, stuck, slope)
    return np.asarray(friction * (scale / np.sqrt(at(radii_m)) - relief))


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
