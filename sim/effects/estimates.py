"""What leaving an effect out would cost: relative errors of F_z, from scales of the scene.

They are bounds of engineering kind, each checked by pressing with and without the effect
(``tests/sim/effects/test_plan.py``), not proofs.
"""

from __future__ import annotations

import math

from sim.scene.indenter import Cylinder, Sphere
from sim.scene.scene import Scene

GRAVITY_M_S2 = 9.81
# What follows bounds presses of a 20 x 25 x 4 mm pad of 0.4 MPa with and without the effect
# (`tacauchy-rig effects-check` makes presses of that kind again).
#
# Linear against finite strain, depths of 2.5, 10 and 20 % of the pad, nu 0.3 and 0.48: a punch with
# a fillet of 0.2 mm 1.6, 10 and 26 %, a ball of 10 mm 2.3, 3.6 and 13 %; s + 2.5 s^2 for a depth s.
_LINEAR, _LINEAR_SQUARE = 1.0, 2.5
# Frictionless against mu 0.5, depths of 2.5 and 10 %, nu 0.3 and 0.48: the punch 1.6 and 5.7 %, the
# ball 0.31 and 0.59 %. A rounded edge grips the gel that flows around it.
_SMOOTH_PUNCH, _SMOOTH_PUNCH_PER_DEPTH = 0.008, 0.6
_SMOOTH_BALL, _SMOOTH_BALL_PER_DEPTH = 0.003, 0.04
# Linear against quadratic tetrahedra on the same mesh, nu 0.3 / 0.4 / 0.48 / 0.499: preset fast,
# punch 13 / 17 / 37 / 237 %, ball 22 / 29 / 60 / 186 %; balanced, punch 11 / 17 / 47 / 265 %, ball
# 16 / 21 / 47 / 215 %; at nu 0 13 and 22 %. The presets' meshes are coarse away from the rim, so
# that linear tetrahedra are poor even where they do not lock.
_P1_PUNCH, _P1_ROUND = 0.13, 0.22
_P1_LOCKING, _P1_POWER = 0.092, 0.6
# Pressed evenly to its depth within 2 ms = 1.45 T1: 0.05 % (ball) and 0.08 % (punch) of the last
# force, 0.07 % with five times as many steps; 5 ms: below 0.01 %.
_INERTIA = 0.005


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


def expected_force(scene: Scene) -> float:
    """Return F_z at a scene's target, estimated for a depth as ``expected_depth`` does [N]."""
    if scene.target.force_n is not None:
        return scene.target.force_n
    return _layer_force(scene, scene.target.depth_m or 0.0)


def _layer_force(scene: Scene, depth_m: float) -> float:
    radius = contact_radius(scene, depth_m)
    ratio = radius / scene.pad.height_m
    kappa = 1.0 + 1.2 * ratio + 1.42 * ratio**2
    material = scene.material
    shape = 2.0 if isinstance(scene.indenter, Cylinder) else 4.0 / 3.0
    return shape * radius * material.young_pa * depth_m * kappa / (1.0 - material.poisson**2)


def linear_error(scene: Scene) -> float:
    """Return the error of small-strain elasticity."""
    share = expected_depth(scene) / scene.pad.height_m
    return _LINEAR * share + _LINEAR_SQUARE * share**2


def frictionless_error(scene: Scene) -> float:
    """Return the error of a frictionless patch where there is friction, for a straight press."""
    share = expected_depth(scene) / scene.pad.height_m
    if isinstance(scene.indenter, Sphere):
        return _SMOOTH_BALL + _SMOOTH_BALL_PER_DEPTH * share
    return _SMOOTH_PUNCH + _SMOOTH_PUNCH_PER_DEPTH * share


def locking_error(scene: Scene) -> float:
    """Return the error of linear tetrahedra, a floor and (nu / (1 - 2 nu))^0.6 above it."""
    poisson = max(m.poisson for m in scene.materials)
    floor = _P1_PUNCH if isinstance(scene.indenter, Cylinder) else _P1_ROUND
    return floor + _P1_LOCKING * float((poisson / (1.0 - 2.0 * poisson)) ** _P1_POWER)


def gravity_error(scene: Scene) -> float:
    """Return rho g H / E, the largest over the materials."""
    height = scene.pad.height_m
    return max(m.density_kg_m3 * GRAVITY_M_S2 * height / m.young_pa for m in scene.materials)


def slowest_period(scene: Scene) -> float:
    """Return T1 = 4 H / sqrt(mu / rho), the clamped layer's first shear period [s]."""
    speed = min(
        math.sqrt(m.young_pa / (2.0 * (1.0 + m.poisson)) / m.density_kg_m3) for m in scene.materials
    )
    return 4.0 * scene.pad.height_m / speed


def inertia_error(scene: Scene) -> float:
    """Return the error of the force at the end of an even press, in proportion to (T1 / t)^2."""
    return _INERTIA * (slowest_period(scene) / scene.duration_s) ** 2


def relaxation_error(scene: Scene) -> float:
    """Return the excess of the force at the end of a press over the slow modulus's.

    Where the slow force grows as t^p, p = 1 or 2, a term of time tau = x t keeps of its stress
    x (1 - exp(-1/x)) or 2 x (1 - x (1 - exp(-1/x))). Under a round end the force grows by no more
    than the square of the depth; under a flat one evenly, but for what finite strain and its fillet
    add. The largest over the materials of sum_i g_i kept_i / g_inf.
    """
    quadratic = 1.0
    if isinstance(scene.indenter, Cylinder):
        rounded = scene.indenter.fillet_m / scene.indenter.radius_m
        quadratic = min(1.0, linear_error(scene) + rounded)
    errors = [0.0]
    for material in scene.materials:
        slow = 1.0 - sum(term.share for term in material.relaxation)
        excess = 0.0
        for term in material.relaxation:
            x = term.time_s / scene.duration_s
            even = -x * math.expm1(-1.0 / x)
            growing = 2.0 * x * (1.0 - even)
            excess += term.share * ((1.0 - quadratic) * even + quadratic * growing)
        errors.append(excess / slow)
    return max(errors)
