"""Rest-stable Stable Neo-Hookean law (Smith, de Goes, Kim 2018, with the logarithmic term).

    psi = m/2 (I - 3) + l/2 (J - alpha)^2 - m/2 ln(I + 1)
    P   = m (1 - 1/(I + 1)) F + l (J - alpha) cof F
    m = 4/3 mu, l = lambda + 5/6 mu, alpha = 1 + 3 m / (4 l)

with I = tr F^T F and J = det F. P(1) = 0 and the tangent at rest is Hooke's law.
"""

import warp as wp

from sim.material.laws.law_and_lame import Law, Tangent, cofactor, lame


@wp.func
def _energy(F: wp.mat33d, p: wp.vec4d) -> wp.float64:
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    # I - 3 and the logarithm are taken about rest, so that small strains keep their digits.
    H = F - wp.identity(n=3, dtype=wp.float64)
    excess = wp.float64(2.0) * wp.trace(H) + wp.ddot(H, H)
    shear = half * p[0] * (excess - wp.log(one + excess / wp.float64(4.0)))
    volume = wp.determinant(F) - one
    return shear + half * p[1] * volume * (volume - wp.float64(2.0) * (p[2] - one))


@wp.func
def _stress(F: wp.mat33d, p: wp.vec4d) -> wp.mat33d:
    one = wp.float64(1.0)
    shear = p[0] * (one - one / (wp.ddot(F, F) + one))
    return F * shear + cofactor(F) * (p[1] * (wp.determinant(F) - p[2]))


@wp.func
def _tangent(F: wp.mat33d, p: wp.vec4d) -> Tangent:
    one = wp.float64(1.0)
    inverse = one / (wp.ddot(F, F) + one)
    t = Tangent()
    t.deformation = F
    t.cofactor = cofactor(F)
    t.a = p[0] * (one - inverse)
    t.b = wp.float64(2.0) * p[0] * inverse * inverse
    t.d = p[1]
    t.e = p[1] * (wp.determinant(F) - p[2])
    return t


def _parameters(young_pa: float, poisson: float) -> tuple[float, float, float, float]:
    mu, lam = lame(young_pa, poisson)
    m, volume = 4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu
    return m, volume, 1.0 + 0.75 * m / volume, 0.0


LAW = Law(
    name="stable-neo-hookean",
    parameters=_parameters,
    energy=_energy,
    stress=_stress,
    tangent=_tangent,
)
