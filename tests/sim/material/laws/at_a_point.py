"""A law's three functions at single deformation gradients, and what ties them together."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from sim.material.laws.tangent import Law, tangent_block
from tacauchy_rig.core.arrays import FloatArray

YOUNG_PA, POISSON = 4e5, 0.45
MU_PA = YOUNG_PA / (2.0 * (1.0 + POISSON))
LAMBDA_PA = YOUNG_PA * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))
# Central differences over so much leave 4e-10 of what they are of.
_STEP = 1e-6


@cache
def _kernel(law: Law) -> Any:
    energy, stress, tangent = law.energy, law.stress, law.tangent

    @wp.kernel(enable_backward=False, module="unique")
    def evaluate(
        deformations: wp.array(dtype=wp.mat33d),
        parameters: wp.vec4d,
        g: wp.vec3d,
        h: wp.vec3d,
        energies_out: wp.array(dtype=wp.float64),
        stresses_out: wp.array(dtype=wp.mat33d),
        blocks_out: wp.array(dtype=wp.mat33d),
    ):
        i = wp.tid()
        F = deformations[i]
        energies_out[i] = energy(F, parameters)
        stresses_out[i] = stress(F, parameters)
        t = tangent(F, parameters)
        G, C = t.deformation, t.cofactor
        blocks_out[i] = tangent_block(t, g, h, G * g, G * h, C * g, C * h)

    return evaluate


def evaluated(
    law: Law, deformations: FloatArray, g: FloatArray, h: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return energy densities [J/m^3], first Piola-Kirchhoff stresses [Pa] and tangent blocks [Pa].

    Args:
        deformations: F, shape [count, 3, 3].
        g: Shape gradient of the rows' node, as ``tangent_block`` takes it.
        h: Shape gradient of the columns' node.
    """
    count = len(deformations)
    kinds = (wp.float64, wp.mat33d, wp.mat33d)
    out = [wp.zeros(count, dtype=kind, device="cpu") for kind in kinds]
    given = wp.array(np.ascontiguousarray(deformations), dtype=wp.mat33d, device="cpu")
    parameters = wp.vec4d(*law.parameters(YOUNG_PA, POISSON))
    inputs = [given, parameters, wp.vec3d(*g), wp.vec3d(*h)]
    wp.launch(_kernel(law), dim=count, inputs=inputs, outputs=out, device="cpu")
    energies, stresses, blocks = (array.numpy() for array in out)
    return energies, stresses, blocks


def energy(law: Law, F: FloatArray) -> float:
    """Return the energy density at one F [J/m^3]."""
    return float(evaluated(law, F[None], np.zeros(3), np.zeros(3))[0][0])


def stress(law: Law, F: FloatArray) -> FloatArray:
    """Return the first Piola-Kirchhoff stress at one F [Pa], shape [3, 3]."""
    return np.asarray(evaluated(law, F[None], np.zeros(3), np.zeros(3))[1][0])


def deformed() -> FloatArray:
    """Return deformation gradients of up to 30 % strain in any direction, shape [20, 3, 3]."""
    rng = np.random.default_rng(11)
    return np.asarray(np.eye(3) + rng.uniform(-0.3, 0.3, (20, 3, 3)))


def turn() -> FloatArray:
    """Return a rotation by 1.1 rad about a skew axis, shape [3, 3]."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    cross = np.cross(np.eye(3), axis)
    return np.asarray(np.eye(3) + np.sin(1.1) * cross + (1.0 - np.cos(1.1)) * cross @ cross)


def derivative_errors(law: Law) -> tuple[float, float]:
    """Return how far the stress is from the energy's slope, and the tangent from the stress's.

    Both over the largest of the latter at each F, the worst of ``deformed``.
    """
    rng = np.random.default_rng(12)
    F, g, h = deformed(), rng.normal(size=3), rng.normal(size=3)
    _, stresses, blocks = evaluated(law, F, g, h)
    slopes, rates = np.zeros_like(stresses), np.zeros_like(blocks)
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = _STEP
            ahead, behind = (evaluated(law, F + s * step, g, h)[0] for s in (1.0, -1.0))
            slopes[:, i, j] = (ahead - behind) / (2.0 * _STEP)
        along = np.zeros((3, 3))
        along[i] = _STEP * h
        ahead, behind = (evaluated(law, F + s * along, g, h)[1] for s in (1.0, -1.0))
        rates[:, :, i] = (ahead - behind) @ g / (2.0 * _STEP)
    return _apart(stresses, slopes), _apart(blocks, rates)


def _apart(found: FloatArray, wanted: FloatArray) -> float:
    size = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    return float((np.abs(found - wanted) / size).max())
