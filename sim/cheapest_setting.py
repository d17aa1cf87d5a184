"""The cheapest settings that keep a tolerance: preset, edge length and effects."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from sim.effects.effect_choice import plan_effects
from sim.effects.planned_effects import full_plan
from sim.effects.press_with_effects import coarse_press, has_own_way
from sim.error_estimate import coarse_reference, estimate_from
from sim.mesh_bias_correction import RelativeCost, Setting, corrected_settings, fold_error
from sim.scene.scene import Output, Preset, Scene
from sim.tolerance import Tolerance
from tacauchy_rig.core.errors import ConfigError, RigError, TimeLimitError
from tacauchy_rig.core.simulated import Alternative

_fast = partial(Setting, Preset.FAST)
FAST = _fast(1.0)
# Medians over 18 presses of punches and balls, 3 depths each up to 25 % of the pad, against the
# limit of finer meshes; by cost. Edges 1.08 times shorter: over the benchmark's scenes, against
# preset reference. Preset paper locks.
RELATIVE_COSTS: dict[Setting, RelativeCost] = {
    _fast(0.62): RelativeCost(0.27, 4.4),
    _fast(0.75): RelativeCost(0.46, 2.6),
    _fast(0.9): RelativeCost(0.66, 1.55),
    FAST: RelativeCost(1.0, 1.0),
    _fast(1.08): RelativeCost(1.24, 0.82),
    _fast(1.18): RelativeCost(1.54, 0.67),
    _fast(1.25): RelativeCost(1.79, 0.59),
    Setting(Preset.PAPER): RelativeCost(1.86, 36.0),
    _fast(1.4): RelativeCost(2.73, 0.46),
    _fast(1.6): RelativeCost(4.49, 0.36),
    _fast(1.8): RelativeCost(6.73, 0.30),
    _fast(2.0): RelativeCost(9.46, 0.25),
    Setting(Preset.BALANCED): RelativeCost(10.1, 0.27),
    _fast(2.2): RelativeCost(20.1, 0.17),
    _fast(2.5): RelativeCost(31.5, 0.145),
    Setting(Preset.ACCURATE): RelativeCost(37.4, 0.156),
    _fast(2.85): RelativeCost(48.7, 0.119),
    _fast(3.3): RelativeCost(109.0, 0.102),
    Setting(Preset.REFERENCE): RelativeCost(140.0, 0.112),
}


def setting_of(scene: Scene) -> Setting:
    """Return a scene's settings."""
    return Setting(scene.preset, scene.refinement, scene.path_refinement)


# Relative error of F_z by which effects are left out where a tolerance is not chosen yet.
_UNDECIDED_TOLERANCE = 1e-3


def keeping(scene: Scene, tolerance: Tolerance) -> Scene:
    """Return a scene with the cheapest settings whose raw force is believed to keep a tolerance.

    The scene is pressed on preset fast and on edges twice as long; what that is worth, every other
    setting is worth in proportion to its error in presses that were measured. Effects are left out
    within what the mesh leaves of the tolerance.

    Raises:
        ConfigError: No settings keep it, or the scene cannot be pressed on preset fast.
    """
    fast = FAST.applied(replace(scene, tolerance=_UNDECIDED_TOLERANCE))
    try:
        plan = plan_effects(fast)
        own, coarse = coarse_press(fast, plan, 1.0), coarse_press(*coarse_reference(fast, plan))
        worth = estimate_from(fast, plan, own.outputs, coarse)
        if worth.force is None:  # nothing touches
            raise ConfigError(worth.basis, remedy="press deeper")
    except TimeLimitError:
        raise
    except RigError as failure:
        raise ConfigError(
            f"no preset is known to keep {tolerance} here: {failure.message}",
            remedy="choose a preset instead",
        ) from failure
    error, force = worth.force, float(own.outputs.force_n[2])
    allowed = tolerance.of(force)
    believed = {
        setting: max(cost.error_ratio * error, fold_error(scene))
        for setting, cost in RELATIVE_COSTS.items()
    }
    if cheapest := next(_within(scene, believed, allowed), None):
        return cheapest
    best = min(believed, key=lambda setting: believed[setting])
    nearest = f"{believed[best]:.2%} ({believed[best] * force:.2g} N)"
    raise ConfigError(
        f"no preset is known to keep {tolerance}, {allowed:.2%} of the force expected; preset "
        f"{best} comes nearest with {nearest}",
        remedy=f"allow {nearest}, or choose preset {best.preset} without a tolerance",
    )


def keeping_corrected(scene: Scene, tolerance: Tolerance) -> Scene:
    """Return a scene with the cheapest settings whose corrected result keeps a tolerance.

    Where none is known or corrected, or none leaves so little, ``keeping`` goes by the raw force.
    """
    return corrected_scene(scene, tolerance) or keeping(scene, tolerance)


def corrected_scene(scene: Scene, tolerance: Tolerance) -> Scene | None:
    """Return a scene with the cheapest settings whose bias is known and keeps a tolerance."""
    stated = {each: worth.error_ratio for each, worth in corrected_settings(scene).items()}
    allowed = _allowed(next(iter(stated)).applied(scene), tolerance) if stated else 0.0
    kept = _within(scene, stated, allowed)
    return next((each for each in kept if has_own_way(each, plan_effects(each))), None)


def _within(scene: Scene, errors: dict[Setting, float], allowed: float) -> Iterator[Scene]:
    """Yield a scene with each setting that errs by so little; effects get what it leaves."""
    for setting, own in errors.items():
        if own <= allowed:
            yield replace(setting.applied(scene), tolerance=allowed - own)


def _allowed(scene: Scene, tolerance: Tolerance) -> float:
    """Return a tolerance relative to F_z; nothing where nothing touches or can be pressed."""
    force = scene.target.force_n
    if tolerance.force_n is not None and force is None:
        try:
            found = coarse_press(scene, full_plan(scene), 1.0)
        except RigError:
            return 0.0
        force = float(found.outputs.force_n[2])
    return tolerance.of(force or 0.0)


def costs_of(scene: Scene) -> dict[Setting, RelativeCost]:
    """Return cost and error of the settings next to a scene's: corrected ones, or raw ones."""
    return RELATIVE_COSTS if scene.path_refinement is None else corrected_settings(scene)


def alternatives(
    scene: Scene,
    error_relative: float | None,
    *,
    wall_s: float | None,
    judged: Output = Output.FORCE,
) -> tuple[Alternative, ...]:
    """Return the next cheaper settings worth their time, and the cheapest of those that are better.

    Args:
        error_relative: Believed of the judged output with the scene's own settings, or None.
        wall_s: What the press took [s]; None before it is made.
        judged: Force or depth.
    """
    costs = costs_of(scene)
    own = costs.get(setting_of(scene))
    if own is None:
        return ()
    # The dearest of the cheaper settings than which none that is cheaper errs less.
    cheaper = min(
        (each for each, worth in costs.items() if worth.time_ratio < own.time_ratio),
        key=lambda each: costs[each].error_ratio,
        default=None,
    )
    # Of presets and ladders some are cheaper and better at once: what is dearer must be better yet.
    least = min(own.error_ratio, costs[cheaper].error_ratio if cheaper else own.error_ratio)
    dearer = (each for each, worth in costs.items() if worth.time_ratio > own.time_ratio)
    better = next((each for each in dearer if costs[each].error_ratio < least), None)
    times = {each: costs[each].time_ratio / own.time_ratio for each in costs}
    errors = {each: costs[each].error_ratio / own.error_ratio for each in costs}
    return tuple(
        Alternative(
            role=role,
            setting=str(each),
            error_relative=error_relative and error_relative * errors[each],
            time_ratio=times[each],
            wall_s=wall_s and wall_s * times[each],
            quantity=judged.value,
        )
        for role, each in {"cheaper": cheaper, "better": better}.items()
        if each is not None
    )
