"""The one form that every law's tangent takes, and the law type itself.

For an isotropic energy psi(I, J) with I = tr F^T F and J = det F, the second derivative contracted
with two shape gradients g and h is the 3 x 3 block

    B = a (g.h) 1 + b (G g)(G h)^T + c [(G g)(C h)^T + (C g)(G h)^T] + d (C g)(C h)^T
        - e [G (g x h)]_x

with G = F, C = cof F, a = 2 psi_I, b = 4 psi_II, c = 2 psi_IJ, d = psi_JJ, e = psi_J, and [w]_x v =
w x v. The linear law is the same form at G = C = 1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import warp as wp

from tacauchy_rig.core.registry import Kind, load


@wp.struct
class Tangent:
    """Second derivative of an energy density at one point, in the form of this file's header.

    A coefficient that a law does not set is zero.
    """

    deformation: wp.mat33d
    cofactor: wp.mat33d
    a: wp.float64
    b: wp.float64
    c: wp.float64
    d: wp.float64
    e: wp.float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A constitutive law."""

    name: str
    # (E [Pa], nu) to the four numbers that the Warp functions take
    parameters: Callable[[float, float], tuple[float, float, float, float]]
    energy: Any  # (F, parameters) to the energy density [J/m^3]
    stress: Any  # (F, parameters) to the first Piola-Kirchhoff stress [Pa]
    tangent: Any  # (F, parameters) to its derivative
    # (E [Pa], nu) to the isotropic stress at F = 1 [Pa]. Where it is not zero, the undeformed pad
    # is no equilibrium.
    rest_stress: Callable[[float, float], float] = lambda _young_pa, _poisson: 0.0
    is_objective: bool = True  # the energy sees no rotations; else it is quadratic in F - 1


def law(name: str) -> Law:
    """Return a law: one of ``LawName``, or one that another package brings.

    Raises:
        ConfigError: There is none of that name, or its package does not import.
    """
    found: Law = load(Kind.LAW, name)
    return found


def lame(young_pa: Any, poisson: Any) -> tuple[Any, Any]:
    """Return the Lame parameters mu and lambda [Pa] of numbers or arrays (paper, Eq. 1)."""
    mu = young_pa / (2.0 * (1.0 + poisson))
    return mu, young_pa * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))


@wp.func
def cofactor(F: Any) -> Any:
    """Return cof F = det(F) F^-T in F's precision, defined for singular F as well."""
    return wp.matrix_from_cols(
        wp.cross(F[:, 1], F[:, 2]), wp.cross(F[:, 2], F[:, 0]), wp.cross(F[:, 0], F[:, 1])
    )


BlockOf = wp.types.matrix(shape=(9, 3), dtype=wp.float64)


@wp.func
def block_of(t: Tangent, g: wp.vec3d) -> BlockOf:
    """Return what times another shape gradient is the block of both, row by row."""
    G, C = t.deformation, t.cofactor
    Gg, Cg = G * g, C * g
    p, r = Gg * t.b + Cg * t.c, Gg * t.c + Cg * t.d
    w = (G * wp.skew(g)) * t.e
    found = BlockOf()
    for k in range(3):
        for a in range(3):
            for b in range(3):
                found[3 * a + b, k] = p[a] * G[b, k] + r[a] * C[b, k]
            found[4 * a, k] += t.a * g[k]
            # Of the cross product's matrix.
            after, last = (a + 1) % 3, (a + 2) % 3
            found[3 * a + after, k] += w[last, k]
            found[3 * a + last, k] -= w[after, k]
    return found
