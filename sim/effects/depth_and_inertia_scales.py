"""Scales of a scene: depth and force that are to be expected, and what weight and inertia cost.

The last two are bounds of engineering kind, each with the range in which it was held against
presses (``tacauchy-rig effects-check --random``).
"""

import math

from sim.scene.indenter import Cylinder, Sphere
from sim.scene.scene import Scene

GRAVITY_M_S2 = 9.81
# Weight stiffens a gel by a share rho g H / E, and moved no output by more than 3.4 times that.
_GRAVITY, _GRAVITY_RANGE = 5.0, 0.02
# In proportion to (T1 / t)^2, from this many periods on. Presses of 2.5 to 50 % of the pad: below
# it the pad rings while it is pressed (F_z of two after 3.0 and 3.2 periods by 1.6 and 4.9 %).
_INERTIA, _INERTIA_PERIODS = 0.05, 4.0
# Of the force expected at the gel's base. Balls carry 0.8 times that at 85 % of the height, punches
# 1.6 times, plates 2.7 times, and with nu 0.499 2.9 times at 57 %.
_BEYOND = 20.0
# Share of the gel's height, or of a softer skin's, from which a sharp rim finds several equilibria,
# which differ in the folds at the rim: one press is 1.7 % deeper with half the load steps.
_FOLDS_FROM = 0.25


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


def most_force(scene: Scene) -> float:
    """Return a force that no gel carries before the indenter has come to its base [N]."""
    stiffest = max(scene.materials, key=lambda material: material.young_pa)
    share = stiffest.young_pa / _young(scene)
    return _BEYOND * share * _layer_force(scene, scene.pad.height_m)


def _layer_force(scene: Scene, depth_m: float) -> float:
    radius = contact_radius(scene, depth_m)
    ratio = radius / scene.pad.height_m
    kappa = 1.0 + 1.2 * ratio + 1.42 * ratio**2
    shape = 2.0 if isinstance(scene.indenter, Cylinder) else 4.0 / 3.0
    return shape * radius * _young(scene) * depth_m * kappa / (1.0 - scene.material.poisson**2)


def _young(scene: Scene) -> float:
    """Return the modulus of a gel, of its layers in series [Pa]."""
    if not scene.layers:
        return scene.material.young_pa
    return 1.0 / sum(layer.share / layer.material.young_pa for layer in scene.layers)


def has_several_equilibria(scene: Scene) -> bool:
    """Return whether a sharp rim is pressed so deep that the least effect chooses between folds."""
    if not scene.has_sharp_rim:
        return False
    folded_m, layers = scene.pad.height_m, scene.layers
    if len(layers) > 1 and layers[-1].material.young_pa < layers[-2].material.young_pa:
        folded_m *= layers[-1].share
    return expected_depth(scene) > _FOLDS_FROM * folded_m


def weight_scale(scene: Scene) -> float:
    """Return rho g H / E, the largest over the materials."""
    height = scene.pad.height_m
    return max(m.density_kg_m3 * GRAVITY_M_S2 * height / m.young_pa for m in scene.materials)


def gravity_error(scene: Scene) -> float | None:
    """Return what leaving weight out costs any output at most; None beyond what was measured."""
    scale = weight_scale(scene)
    return _GRAVITY * scale if scale <= _GRAVITY_RANGE else None


def slowest_period(scene: Scene) -> float:
    """Return T1 = 4 H / sqrt(mu / rho), the clamped layer's first shear period [s]."""
    speed = min(
        math.sqrt(m.young_pa / (2.0 * (1.0 + m.poisson)) / m.density_kg_m3) for m in scene.materials
    )
    return 4.0 * scene.pad.height_m / speed


def inertia_error(scene: Scene) -> float | None:
    """Return what leaving inertia out costs any output at most; None for a press too quick."""
    periods = scene.duration_s / slowest_period(scene)
    return _INERTIA / periods**2 if periods >= _INERTIA_PERIODS else None
