"""Hooke's law on the small-strain tensor: the limit that the analytic references describe.

    psi = mu e:e + lambda/2 tr(e)^2,  e = (F + F^T)/2 - 1
    P   = mu (F + F^T - 2) + lambda tr(F - 1) 1

Not objective: rotations of more than a few degrees give spurious stress.
"""

import warp as wp

from sim.material.laws.law_and_lame import Law, Tangent, lame


@wp.func
def _energy(F: wp.mat33d, p: wp.vec4d) -> wp.float64:
    H = F - wp.identity(n=3, dtype=wp.float64)
    strain = (H + wp.transpose(H)) * wp.float64(0.5)
    volume = wp.trace(H)
    return p[0] * wp.ddot(strain, strain) + wp.float64(0.5) * p[1] * volume * volume


@wp.func
def _stress(F: wp.mat33d, p: wp.vec4d) -> wp.mat33d:
    identity = wp.identity(n=3, dtype=wp.float64)
    H = F - identity
    return (H + wp.transpose(H)) * p[0] + identity * (p[1] * wp.trace(H))


@wp.func
def _tangent(F: wp.mat33d, p: wp.vec4d) -> Tangent:
    # mu h g^T = mu g h^T + mu [g x h]_x, which brings Hooke's law into the shared form.
    t = Tangent()
    t.deformation = wp.identity(n=3, dtype=wp.float64)
    t.cofactor = wp.identity(n=3, dtype=wp.float64)
    t.a = p[0]
    t.d = p[1] + p[0]
    t.e = -p[0] + wp.float64(0.0) * F[0, 0]
    return t


LAW = Law(
    name="linear",
    parameters=lambda young_pa, poisson: (*lame(young_pa, poisson), 0.0, 0.0),
    energy=_energy,
    stress=_stress,
    tangent=_tangent,
    is_objective=False,
)
