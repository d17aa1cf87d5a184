"""The law as the paper prints it (Eq. 2 and 4), kept to reproduce the paper and nothing else.

    psi = mu/2 (I - 3) + lambda/2 (J - 1)^2
    P   = mu F + lambda (J - 1) cof F
    sigma = mu/J F F^T + lambda (J - 1) 1

with I = tr F^T F and J = det F. P(1) = mu 1: at rest every point is under tension, so a free pad
shrinks to the stretch s that solves mu = lambda s (1 - s^3), 4 % per axis at nu = 0.45 and 1.4 % at
nu = 0.48, and a clamped one is pulled in at its sides and top.
"""

import warp as wp

from sim.material.laws.law_and_lame import Law, Tangent, cofactor, lame

# Largest value of s (1 - s^3), at s = 4^(-1/3).
_PUSH_MAX = 0.75 * 4.0 ** (-1.0 / 3.0)


@wp.func
def _energy(F: wp.mat33d, p: wp.vec4d) -> wp.float64:
    H = F - wp.identity(n=3, dtype=wp.float64)
    volume = wp.determinant(F) - wp.float64(1.0)
    excess = wp.float64(2.0) * wp.trace(H) + wp.ddot(H, H)
    return wp.float64(0.5) * (p[0] * excess + p[1] * volume * volume)


@wp.func
def _stress(F: wp.mat33d, p: wp.vec4d) -> wp.mat33d:
    return F * p[0] + cofactor(F) * (p[1] * (wp.determinant(F) - wp.float64(1.0)))


@wp.func
def _tangent(F: wp.mat33d, p: wp.vec4d) -> Tangent:
    t = Tangent()
    t.deformation = F
    t.cofactor = cofactor(F)
    t.a = p[0]
    t.d = p[1]
    t.e = p[1] * (wp.determinant(F) - wp.float64(1.0))
    return t


def free_stretch(poisson: float) -> float:
    """Return the stretch at which a gel that nothing holds has no stress.

    Zero below nu = 0.34, where the volume term is too weak to stop it: it collapses to a point.
    """
    mu, lam = lame(1.0, poisson)
    if mu > lam * _PUSH_MAX:
        return 0.0
    stretch = 1.0
    for _ in range(50):
        # Newton from above, where the function is concave and falls: it never overshoots.
        stretch += (mu / lam - stretch + stretch**4) / (1.0 - 4.0 * stretch**3)
    return stretch


LAW = Law(
    name="paper-eq4",
    parameters=lambda young_pa, poisson: (*lame(young_pa, poisson), 0.0, 0.0),
    energy=_energy,
    stress=_stress,
    tangent=_tangent,
    rest_stress=lambda young_pa, poisson: lame(young_pa, poisson)[0],
)
