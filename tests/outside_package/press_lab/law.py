"""Neo-Hookean law with a logarithmic volume term (Bonet and Wood, 2nd edition, Eq. 6.27).

    psi = mu/2 (I - 3) - mu ln J + lambda/2 (ln J)^2
    P   = mu F + (lambda ln J - mu) / J cof F

with I = tr F^T F and J = det F. Infinite for J <= 0.
"""

import warp as wp

from sim.material.laws.law_and_lame import Law, Tangent, cofactor, lame


@wp.func
def _energy(F: wp.mat33d, p: wp.vec4d) -> wp.float64:
    J = wp.determinant(F)
    if wp.float64(0.0) >= J:
        return wp.float64(wp.inf)
    half = wp.float64(0.5)
    log = wp.log(J)
    shear = half * p[0] * (wp.ddot(F, F) - wp.float64(3.0)) - p[0] * log
    return shear + half * p[1] * log * log


@wp.func
def _stress(F: wp.mat33d, p: wp.vec4d) -> wp.mat33d:
    J = wp.determinant(F)
    return F * p[0] + cofactor(F) * ((p[1] * wp.log(J) - p[0]) / J)


@wp.func
def _tangent(F: wp.mat33d, p: wp.vec4d) -> Tangent:
    J = wp.determinant(F)
    log = wp.log(J)
    t = Tangent()
    t.deformation = F
    t.cofactor = cofactor(F)
    t.a = p[0]
    t.b = wp.float64(0.0)
    t.c = wp.float64(0.0)
    t.d = (p[0] + p[1] * (wp.float64(1.0) - log)) / (J * J)
    t.e = (p[1] * log - p[0]) / J
    return t


def _parameters(young_pa: float, poisson: float) -> tuple[float, float, float, float]:
    mu, lambda_ = lame(young_pa, poisson)
    return mu, lambda_, 0.0, 0.0


LAW = Law(
    name="log-neo-hookean", parameters=_parameters, energy=_energy, stress=_stress, tangent=_tangent
)
