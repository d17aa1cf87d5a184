"""A rigid flat punch on bonded elastic layers, frictionless, small strain: a reference.

Each layer is integrated in Hankel space. With u_r = U J1(kr), u_z = W J0(kr), tau_rz = T J1(kr) and
sigma_zz = S J0(kr), equilibrium and Hooke's law are

    U' = k W + T / mu          T' = k ((lambda + 2 mu) k U + lambda W')
    W' = (S - lambda k U) / (lambda + 2 mu)                         S' = -k T

The stiffness of all that lies below, (T, S) = K (U, W), is carried up from the clamped base in thin
slices, where the exponentials stay small. At the surface W = C(k) S, and L(k) = C k E / (2 (1 -
nu^2)) tends to 1 for short waves. The punch's dual integral equations become, for 0 <= t <= a,

    phi(t) + int_0^a phi(s) K(t, s) ds = d E / (pi (1 - nu^2))
    K(t, s) = 2/pi int_0^inf (L(k) - 1) cos(kt) cos(ks) dk
    F = 2 pi int_0^a phi(t) dt

(E and nu of the uppermost layer), as Hayes et al. 1972 have it for one layer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from sim.arrays import FloatArray
from sim.scene.material import Layer
from tacauchy_rig.errors import ConfigError

_WAVE_COUNT = 1200
_POINT_COUNT = 160


def punch_force(
    layers: Sequence[Layer], *, height_m: float, radius_m: float, depth_m: float
) -> float:
    """Return the force of a flat punch on layers of infinite extent [N].

    Raises:
        ConfigError: There is no layer.
    """
    if not layers:
        raise ConfigError("a laminate of no layers", remedy="give at least one layer")
    top = layers[-1]
    shortest = 12.0 / min(top.share * height_m, 0.1 * radius_m)
    wave, wave_weight = _gauss(0.0, shortest, _WAVE_COUNT)
    excess = _surface_compliance(layers, height_m, wave) - 1.0
    t, weight = _gauss(0.0, radius_m, _POINT_COUNT)
    cosines = np.cos(np.outer(t, wave))
    kernel = 2.0 / np.pi * (cosines * (excess * wave_weight)) @ cosines.T
    modulus = top.material.young_pa / (1.0 - top.material.poisson**2)
    right = np.full(len(t), depth_m * modulus / np.pi)
    phi = np.linalg.solve(np.eye(len(t)) + kernel * weight, right)
    return float(2.0 * np.pi * weight @ phi)


def _surface_compliance(layers: Sequence[Layer], height_m: float, wave: FloatArray) -> FloatArray:
    """Return L at every wave number."""
    stiffness: FloatArray = np.empty(0)
    for layer in layers:
        thickness = layer.share * height_m
        slices = max(4, int(np.ceil(wave.max() * thickness)))
        step = scipy.linalg.expm(_system(layer, wave) * (thickness / slices))
        kept, forced = step[:, :2, :2], step[:, :2, 2:]
        raised, carried = step[:, 2:, :2], step[:, 2:, 2:]
        for _ in range(slices):
            if not stiffness.size:
                stiffness = carried @ np.linalg.inv(forced)
            else:
                motion = kept + forced @ stiffness
                stiffness = (raised + carried @ stiffness) @ np.linalg.inv(motion)
    compliance = np.linalg.inv(stiffness)[:, 1, 1]
    top = layers[-1].material
    return np.asarray(compliance * wave * top.young_pa / (2.0 * (1.0 - top.poisson**2)))


def _system(layer: Layer, wave: FloatArray) -> FloatArray:
    """Return d/dz of (U, W, T, S) for every wave number, shape [wave_count, 4, 4]."""
    young, poisson = layer.material.young_pa, layer.material.poisson
    mu = young / (2.0 * (1.0 + poisson))
    lam = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    axial = lam + 2.0 * mu
    system = np.zeros((len(wave), 4, 4))
    system[:, 0, 1], system[:, 0, 2] = wave, 1.0 / mu
    system[:, 1, 0], system[:, 1, 3] = -lam * wave / axial, 1.0 / axial
    system[:, 2, 0] = wave**2 * (axial - lam**2 / axial)
    system[:, 2, 3] = wave * lam / axial
    system[:, 3, 2] = -wave
    return system


def _gauss(low: float, high: float, count: int) -> tuple[FloatArray, FloatArray]:
    at, weight = np.polynomial.legendre.leggauss(count)
    return low + 0.5 * (high - low) * (at + 1.0), 0.5 * (high - low) * weight
