"""The error of one scene's F_z, from presses of the same scene on coarser meshes.

Where the error falls with the edge length h as h^p, presses on edges h and c h differ by c^p - 1
times the error of the first (Richardson 1911; as an uncertainty with a factor of safety: Roache
1994, the grid convergence index). Meshes are not nested here, so that what a rim or a contact's
edge happens to cut adds a part that no extrapolation sees.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.effects.effect_plan import EffectPlan
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for, solve
from sim.press import PressResult
from sim.scene.scene import Preset, Scene, Target
from tacauchy_rig.errors import RigError

COARSENINGS = (1.5, 2.0)
ORDER_SHARP = 1.0
ORDER_SMOOTH = 2.0
# The usual value; a scene of sim.studies.verification.training needs 0.7 at most,
# one of those held out needed 0.98.
SAFETY_FACTOR = 1.25
CHANCE_RELATIVE = 2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarserForce:
    """F_z on a mesh whose edges are ``ratio`` times as long."""

    ratio: float
    force_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceErrorEstimate:
    """What one F_z is worth.

    Attributes:
        relative: Relative error, or None; ``basis`` says how or why not.
    """

    relative: float | None
    basis: str


def richardson_error(force_n: float, coarser: Sequence[CoarserForce], *, order: float) -> float:
    """Return the relative error that the coarser meshes suggest: the largest of their estimates.

    Args:
        force_n: F_z on the mesh that is judged [N], not zero.
        order: p.
    """
    return max(
        abs(other.force_n / force_n - 1.0) / (float(other.ratio**order) - 1.0) for other in coarser
    )


def error_order(scene: Scene) -> float:
    """Return the order at which F_z is taken to converge.

    Stress is singular at a sharp rim.
    """
    return ORDER_SHARP if scene.has_sharp_rim else ORDER_SMOOTH


def estimate_force_error(scene: Scene, *, depth_m: float, force_n: float) -> ForceErrorEstimate:
    """Press a scene again on coarser meshes and say what its F_z is worth.

    Preset paper has but one mesh; its press is compared with preset balanced instead.

    Args:
        depth_m: Where the press ended [m]; the others go there too.
        force_n: Its F_z [N].
    """
    if not force_n > 0.0:
        return ForceErrorEstimate(relative=None, basis="there is no force to be wrong about")
    plan = plan_effects(scene)
    held = replace(scene, target=Target(depth_m=depth_m))
    try:
        if scene.preset is Preset.PAPER:
            return _against_balanced(held, force_n)
        coarser = [
            CoarserForce(ratio=ratio, force_n=force_on(held, plan, refinement=1.0 / ratio))
            for ratio in COARSENINGS
        ]
    except RigError as error:
        return ForceErrorEstimate(
            relative=None, basis=f"the same press on another mesh failed: {error.message}"
        )
    return estimate_from(scene, force_n, coarser, left_out=plan.estimated_error)


def with_estimate(scene: Scene, result: PressResult) -> PressResult:
    """Return a press's result with its error estimated on coarser meshes."""
    started = time.perf_counter()
    found = estimate_force_error(scene, depth_m=result.depth_m, force_n=result.force_n[2])
    return replace(
        result,
        estimated_force_error_relative=found.relative,
        estimated_force_error_basis=found.basis,
        wall_s={**result.wall_s, "estimate": time.perf_counter() - started},
    )


def estimate_from(
    scene: Scene, force_n: float, coarser: Sequence[CoarserForce], *, left_out: float = 0.0
) -> ForceErrorEstimate:
    """Return the estimate from forces at hand.

    Args:
        left_out: Relative error that the plan estimates for the effects left out.
    """
    order = error_order(scene)
    mesh = SAFETY_FACTOR * richardson_error(force_n, coarser, order=order)
    found = ", ".join(f"{other.force_n:.4f} N on {other.ratio:g} h" for other in coarser)
    effects = f", {left_out:.2%} for effects left out" if left_out else ""
    return ForceErrorEstimate(
        relative=mesh + CHANCE_RELATIVE + left_out,
        basis=(
            f"Richardson: {found}; order {order:g}, factor of safety {SAFETY_FACTOR:g}, "
            f"{CHANCE_RELATIVE:.2%} for what no extrapolation sees{effects}"
        ),
    )


def force_on(scene: Scene, plan: EffectPlan, *, refinement: float) -> float:
    """Return a scene's F_z on a mesh with edges ``refinement`` times shorter [N].

    Raises:
        RigError: It cannot be meshed or solved there.
    """
    path = path_for(scene, plan, refinement=refinement)
    return float(solve(scene, plan, path).force_n[2])


def _against_balanced(scene: Scene, force_n: float) -> ForceErrorEstimate:
    finer = replace(scene, preset=Preset.BALANCED)
    plan = plan_effects(finer)
    force = force_on(finer, plan, refinement=1.0)
    return ForceErrorEstimate(
        relative=abs(force / force_n - 1.0) + CHANCE_RELATIVE,
        basis=f"preset {Preset.BALANCED} gives {force:.4f} N at the same depth",
    )
