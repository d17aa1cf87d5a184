"""What leaving an effect out would cost: relative errors of F_z, from scales of the scene.

They are bounds of engineering kind, each checked by pressing with and without the effect
(``tests/sim/test_effects.py``), not proofs.
"""

from __future__ import annotations

import math

from sim.indenter import Cylinder, Sphere
from sim.scene import Material, Scene

GRAVITY_M_S2 = 9.81
# F_z of a linear against a finite-strain press of a bonded layer, per depth over thickness: -6 % at
# 11 % depth and -13 % at 22 %.
_LINEAR_PER_DEPTH_SHARE = 0.6
# F_z of a bonded against a frictionless patch, per 1 - 2 nu, flat punch; and what its rim adds per
# depth over thickness.
_PATCH_PER_COMPRESSIBILITY = 0.17
_PATCH_PER_DEPTH_SHARE = 0.06
# F_z of linear against quadratic tetrahedra on the presets' own meshes, at nu = 0 and per
# nu / (1 - 2 nu).
_P1_FLOOR = 0.02
_P1_LOCKING = 0.02


def contact_radius(scene: Scene, depth_m: float) -> float:
    """Return about how wide the indenter will touch [m]."""
    indenter = scene.indenter
    if isinstance(indenter, Cylinder):
        return indenter.radius_m
    if isinstance(indenter, Sphere):
        return float(min(math.sqrt(1.5 * indenter.radius_m * depth_m), indenter.radius_m))
    return float(min(scene.pad.half_extents()))


def expected_depth(scene: Scene) -> float:
    """Return the depth of a scene's target, estimated by a bonded linear layer for a force [m].

    F = 2 a E d kappa / (1 - nu^2), with kappa = 1 + 1.2 a/h + 1.42 (a/h)^2 through the values of
    Hayes et al. 1972 for nu = 0.5; a rounded indenter's a follows its depth.
    """
    if scene.target.depth_m is not None:
        return scene.target.depth_m
    force = scene.target.force_n or 0.0
    low, high = 0.0, scene.pad.height_m
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _layer_force(scene, middle) < force else (low, middle)
    return high


def _layer_force(scene: Scene, depth_m: float) -> float:
    radius = contact_radius(scene, depth_m)
    ratio = radius / scene.pad.height_m
    kappa = 1.0 + 1.2 * ratio + 1.42 * ratio**2
    material = scene.material
    shape = 2.0 if isinstance(scene.indenter, Cylinder) else 4.0 / 3.0
    return shape * radius * material.young_pa * depth_m * kappa / (1.0 - material.poisson**2)


def linear_error(scene: Scene) -> float:
    """Return the error of small-strain elasticity."""
    return _LINEAR_PER_DEPTH_SHARE * expected_depth(scene) / scene.pad.height_m


def frictionless_error(scene: Scene) -> float:
    """Return the error of a frictionless patch where there is friction, for a straight press."""
    compressible = 1.0 - 2.0 * scene.material.poisson
    share = expected_depth(scene) / scene.pad.height_m
    return _PATCH_PER_COMPRESSIBILITY * compressible + _PATCH_PER_DEPTH_SHARE * share


def locking_error(scene: Scene) -> float:
    """Return the error of linear tetrahedra."""
    poisson = max(m.poisson for m in materials(scene))
    return _P1_FLOOR + _P1_LOCKING * poisson / (1.0 - 2.0 * poisson)


def gravity_error(scene: Scene) -> float:
    """Return rho g H / E, the largest over the materials."""
    height = scene.pad.height_m
    return max(m.density_kg_m3 * GRAVITY_M_S2 * height / m.young_pa for m in materials(scene))


def slowest_period(scene: Scene) -> float:
    """Return T1 = 4 H / sqrt(mu / rho), the clamped layer's first shear period [s]."""
    speed = min(
        math.sqrt(m.young_pa / (2.0 * (1.0 + m.poisson)) / m.density_kg_m3)
        for m in materials(scene)
    )
    return 4.0 * scene.pad.height_m / speed


def inertia_error(scene: Scene) -> float:
    """Return (T1 / t_load)^2."""
    return (slowest_period(scene) / scene.duration_s) ** 2


def relaxation_error(scene: Scene) -> float:
    """Return the excess of the force at the end of a ramp over the slow modulus's.

    sum_i g_i tau_i / t (1 - exp(-t / tau_i)) / g_inf, the largest over the materials.
    """
    time = scene.duration_s
    errors = [0.0]
    for material in materials(scene):
        slow = 1.0 - sum(term.share for term in material.relaxation)
        excess = sum(
            term.share * term.time_s / time * -math.expm1(-time / term.time_s)
            for term in material.relaxation
        )
        errors.append(excess / slow)
    return max(errors)


def materials(scene: Scene) -> tuple[Material, ...]:
    """Return every material of a scene."""
    return tuple(layer.material for layer in scene.layers) or (scene.material,)
