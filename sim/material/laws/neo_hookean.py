"""Isochoric neo-Hookean law with a quadratic volume term.

    psi = mu/2 (J^(-2/3) I - 3) + K/2 (J - 1)^2
    P   = mu J^(-2/3) F + [K (J - 1) - mu/3 I J^(-5/3)] cof F

with I = tr F^T F, J = det F, K = E / (3 (1 - 2 nu)). Infinite for J <= 0.
"""

import warp as wp

from sim.material.laws.law_and_lame import Law, Tangent, cofactor, lame


@wp.func
def _energy(F: wp.mat33d, p: wp.vec4d) -> wp.float64:
    J = wp.determinant(F)
    if wp.float64(0.0) >= J:
        return wp.float64(wp.inf)
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    power = wp.exp(wp.log(J) * wp.float64(-2.0) / wp.float64(3.0))
    shear = half * p[0] * (power * wp.ddot(F, F) - wp.float64(3.0))
    return shear + half * p[1] * (J - one) * (J - one)


@wp.func
def _stress(F: wp.mat33d, p: wp.vec4d) -> wp.mat33d:
    J = wp.determinant(F)
    power = wp.exp(wp.log(J) * wp.float64(-2.0) / wp.float64(3.0))
    volume = p[1] * (J - wp.float64(1.0))
    shear = p[0] * power * wp.ddot(F, F) / (wp.float64(3.0) * J)
    return F * (p[0] * power) + cofactor(F) * (volume - shear)


@wp.func
def _tangent(F: wp.mat33d, p: wp.vec4d) -> Tangent:
    J = wp.determinant(F)
    trace = wp.ddot(F, F)
    power = wp.exp(wp.log(J) * wp.float64(-2.0) / wp.float64(3.0))
    third = wp.float64(1.0) / wp.float64(3.0)  # Warp divides bare literals in float32
    t = Tangent()
    t.deformation = F
    t.cofactor = cofactor(F)
    t.a = p[0] * power
    t.c = wp.float64(-2.0) * third * p[0] * power / J
    t.d = p[1] + wp.float64(5.0) / wp.float64(9.0) * p[0] * power * trace / (J * J)
    t.e = p[1] * (J - wp.float64(1.0)) - third * p[0] * power * trace / J
    return t


def _parameters(young_pa: float, poisson: float) -> tuple[float, float, float, float]:
    mu, _ = lame(young_pa, poisson)
    return mu, young_pa / (3.0 * (1.0 - 2.0 * poisson)), 0.0, 0.0


LAW = Law(
    name="neo-hookean", parameters=_parameters, energy=_energy, stress=_stress, tangent=_tangent
)
