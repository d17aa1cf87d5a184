"""Exact small-strain forces on a layer bonded to a rigid base: what a press has to meet.

A frictionless punch or ball of contact radius a on a layer of thickness h carries
F = 2 a E / (1 - nu^2) int_0^1 phi (Hayes et al. 1972). In Lebedev and Ufliand's reduction of the
dual integral equations phi is even and solves, on [-1, 1],

    phi(x) - a / (pi h) int K(a (x - t) / h) phi(t) dt = f(x),
    K(u) = int_0^inf (1 - N(w)) cos(w u) dw,

where N is the layer's compliance to a wave of wave number w / h, relative to a half space's. A flat
punch has f = d; a ball has f = d - a^2 x^2 / R, and a is where phi(1) = 0.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.optimize

from sim.arrays import FloatArray

_WAVE_NUMBER_MAX = 40.0
_WAVE_COUNT = 200
_POINT_COUNT = 60


def layer_compliance(wave: FloatArray, poisson: float) -> FloatArray:
    """Return N at wave numbers times thickness: 0 for long waves, 1 for short ones."""
    k = 3.0 - 4.0 * poisson
    rising = 2.0 * k * np.sinh(2.0 * wave) - 4.0 * wave
    return np.asarray(rising / (2.0 * k * np.cosh(2.0 * wave) + 4.0 * wave**2 + 1.0 + k**2))


def punch_factor(radius_over_height: float, poisson: float) -> float:
    """Return kappa = F (1 - nu^2) / (2 a E d) of a flat punch; 1 on a half space."""
    phi = _Density(radius_over_height, poisson)
    return phi.mean(0)


def punch_force(
    *, radius_m: float, height_m: float, depth_m: float, young_pa: float, poisson: float
) -> float:
    """Return the force of a frictionless flat punch on an endless bonded layer [N]."""
    kappa = punch_factor(radius_m / height_m, poisson)
    return 2.0 * radius_m * young_pa * depth_m * kappa / (1.0 - poisson**2)


def hertz_force(*, radius_m: float, depth_m: float, young_pa: float, poisson: float) -> float:
    """Return Hertz's force of a ball on a half space [N]: 4/3 E / (1 - nu^2) sqrt(R) d^1.5."""
    return 4.0 / 3.0 * young_pa / (1.0 - poisson**2) * math.sqrt(radius_m * depth_m) * depth_m


def ball_force(
    *, radius_m: float, height_m: float, depth_m: float, young_pa: float, poisson: float
) -> tuple[float, float]:
    """Return a frictionless ball's force [N] and contact radius [m] on an endless bonded layer.

    The ball is the paraboloid of its radius, as in Hertz's theory.
    """

    def excess(contact_m: float) -> float:
        phi = _Density(contact_m / height_m, poisson)
        return depth_m * phi.rim(0) - contact_m**2 / radius_m * phi.rim(2)

    widest = math.sqrt(2.0 * radius_m * depth_m)
    contact = float(scipy.optimize.brentq(excess, 0.1 * widest, 2.0 * widest))
    phi = _Density(contact / height_m, poisson)
    mean = depth_m * phi.mean(0) - contact**2 / radius_m * phi.mean(2)
    return 2.0 * contact * young_pa / (1.0 - poisson**2) * mean, contact


class _Density:
    """phi for f = 1 and f = x^2, by Nystroem's method on Gauss points.

    Args:
        radius_over_height: a / h.
        poisson: Poisson's ratio of the layer.
    """

    def __init__(self, radius_over_height: float, poisson: float) -> None:
        points, self._weights = np.polynomial.legendre.leggauss(_POINT_COUNT)
        at = np.append(points, 1.0)
        wave, share = np.polynomial.legendre.leggauss(_WAVE_COUNT)
        wave = (wave + 1.0) * 0.5 * _WAVE_NUMBER_MAX
        missing = share * 0.5 * _WAVE_NUMBER_MAX * (1.0 - layer_compliance(wave, poisson))
        even, odd = (part(np.outer(wave, at * radius_over_height)) for part in (np.cos, np.sin))
        kernel = even.T @ (missing[:, None] * even) + odd.T @ (missing[:, None] * odd)
        coupling = radius_over_height / math.pi * kernel[:, :-1] * self._weights
        system = np.eye(_POINT_COUNT) - coupling[:-1]
        self._values = {power: np.linalg.solve(system, points**power) for power in (0, 2)}
        self._rim = {power: 1.0 + float(coupling[-1] @ self._values[power]) for power in (0, 2)}

    def mean(self, power: int) -> float:
        """Return int_0^1 phi for f = x^power."""
        return 0.5 * float(self._weights @ self._values[power])

    def rim(self, power: int) -> float:
        """Return phi(1) for f = x^power."""
        return self._rim[power]
