"""Which effects a scene calls for: ``Scene`` in, ``EffectPlan`` out.

An effect is left out where that is shown to change no output that is asked for by more than its
tolerance, all that is left out taken together. What is off is not compiled, not launched and not
allocated.

Weight and inertia have scales that bound them, each within a range; outside it they are on, as
relaxation is: leaving it or weight out saves 8 % of a press's time. Friction takes half of it, and
is tried: the scene is pressed coarsely with and without. Trying costs time too; beside load steps
on a mesh of their own it would be more than it can save. Where a press has several equilibria,
nothing is left out: what is small chooses between them.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

from sim.effects import depth_and_inertia_scales as estimates
from sim.effects.planned_effects import EffectPlan, full_plan
from sim.effects.press_with_effects import COARSE_RATIOS, coarse_press
from sim.scene.scene import Effect, Output, Preset, Scene
from tacauchy_rig.core.errors import RigError, TimeLimitError

# Relative error of F_z that all effects left out may have together.
PRESET_TOLERANCE = {
    Preset.FAST: 0.05,
    Preset.BALANCED: 0.02,
    Preset.ACCURATE: 0.005,
    Preset.REFERENCE: 2e-4,
    Preset.PAPER: 2e-4,
}
# What another output may be off by, over F_z's: fields scatter more than their sums.
_FIELDS_OVER_FORCE = 2.0
_SUMS = {Output.FORCE, Output.DEPTH}
# What may be left out, by scale or by trying; nothing else that is small saves time.
_SMALL = (Effect.INERTIA, Effect.GRAVITY, Effect.FRICTION, Effect.VISCOELASTICITY)
# A fine press's difference is at most so many times that of its one coarse press (1.5 in F_z, 3.2
# in a field in 60 drawn presses). With two it is the finer one's and what the two are apart.
_ONE_COARSE, _ONE_COARSE_FIELDS = 2.0, 4.0
# Trying would only confirm that friction is needed where mu is so many tolerances of shear or
# markers: a straight press's tangential traction came out as 0.06 to 0.7 mu of the pressure, and a
# plan doubles what it finds.
_GRIPS = 1.0
_FOLDS = "a sharp rim this deep has several equilibria, between which the least effect chooses"
_KEPT = 256
# A tolerance that is none; it keeps quotients finite.
_NOTHING = 1e-30


@lru_cache(maxsize=_KEPT)
def plan_effects(scene: Scene) -> EffectPlan:
    """Decide which effects of a scene are simulated; the result is cached.

    Raises:
        ConfigError: The user switched an effect on or off that cannot be.
    """
    plan = replace(full_plan(scene), tolerances=output_tolerances(scene))
    if estimates.has_several_equilibria(scene):
        for effect in _SMALL:
            if _is_open(plan, effect):
                plan = _with(plan, effect, reason=f"on untried: {_FOLDS}")
        return plan
    bounds = {
        Effect.GRAVITY: estimates.gravity_error(scene),
        Effect.INERTIA: estimates.inertia_error(scene),
    }
    for effect, bound in bounds.items():
        if _is_open(plan, effect) and bound is not None:
            plan = _weighed(plan, effect, dict.fromkeys(Output, bound), "by its scale")
    return _judged(scene, plan) if _is_open(plan, Effect.FRICTION) else plan


def output_tolerances(scene: Scene) -> dict[Output, float]:
    """Return the relative tolerance of every output that a scene asks for.

    A press to a force asks for its depth, and a press to a depth for its force.
    """
    force = PRESET_TOLERANCE[scene.preset] if scene.tolerance is None else scene.tolerance
    given = dict(scene.output_tolerances)
    sought = Output.FORCE if scene.target.force_n is None else Output.DEPTH
    asked = {sought, Output.FORCE, *scene.outputs, *given}
    return {
        output: given.get(output, force if output in _SUMS else _FIELDS_OVER_FORCE * force)
        for output in Output
        if output in asked
    }


def _is_open(plan: EffectPlan, effect: Effect) -> bool:
    """Return whether an effect is on and nobody asked for that."""
    return plan.rows[effect].on and not plan.rows[effect].asked


def _judged(scene: Scene, plan: EffectPlan) -> EffectPlan:
    """Return a plan after friction was tried, or was not."""
    if why := _why_untried(scene, plan):
        return _with(plan, Effect.FRICTION, reason=f"on untried: {why}")
    try:
        costs, spent = _tried(scene, plan)
    except TimeLimitError:
        raise
    except RigError as error:
        why = f"on, as a coarse press failed: {error.message}"
        return _with(plan, Effect.FRICTION, reason=why)
    edges = " and ".join(f"{1.0 / ratio:g}" for ratio in COARSE_RATIOS[scene.preset])
    basis = f"tried on edges {edges} times as long"
    return _weighed(replace(plan, tried_s=spent), Effect.FRICTION, costs, basis)


def _why_untried(scene: Scene, plan: EffectPlan) -> str:
    """Say why a scene has its friction without a try, or nothing."""
    if any(scene.motion.shift_m) or scene.motion.twist_rad:
        return "the indenter moves along the gel"
    for output in (Output.SHEAR, Output.MARKERS):
        allowed = plan.tolerances.get(output)
        if allowed is not None and scene.friction > _GRIPS * allowed:
            return f"{output.value} is asked for to {allowed:.1%}, and mu is {scene.friction:g}"
    if scene.path_refinement is not None:
        return "trying costs 60% of a press's time and may save 50%"
    return "" if COARSE_RATIOS[scene.preset] else "preset paper has one mesh"


def _tried(scene: Scene, plan: EffectPlan) -> tuple[dict[Output, float], float]:
    """Return what leaving friction out costs each output, and the processor's time for it [s]."""
    without = _with(plan, Effect.FRICTION, on=False)
    found, spent = [], 0.0
    for ratio in COARSE_RATIOS[scene.preset]:
        pressed = [coarse_press(scene, each, ratio) for each in (without, plan)]
        spent += sum(each.processor_s for each in pressed)
        found.append(pressed[0].outputs.differences(pressed[1].outputs))
    coarse, fine = found[0], found[-1]
    costs = {
        output: fine[output] + abs(fine[output] - coarse[output])
        if len(found) > 1
        else (_ONE_COARSE if output in _SUMS else _ONE_COARSE_FIELDS) * fine[output]
        for output in fine
    }
    return costs, spent


def _weighed(
    plan: EffectPlan, effect: Effect, costs: dict[Output, float], basis: str
) -> EffectPlan:
    """Leave an effect out if that keeps every tolerance, with what is left out already."""
    sums = {output: plan.left_out(output) + costs[output] for output in plan.tolerances}
    worst = max(sums, key=lambda output: sums[output] / max(plan.tolerances[output], _NOTHING))
    on = sums[worst] > plan.tolerances[worst]
    verb = "would be" if on else "is"
    reason = (
        f"{basis}; with all that is left out {worst.value} {verb} {sums[worst]:.2%} off, "
        f"{plan.tolerances[worst]:.2%} allowed"
    )
    return _with(plan, effect, on=on, costs=costs, reason=reason)


def _with(plan: EffectPlan, effect: Effect, *, reason: str = "", **changes: Any) -> EffectPlan:
    """Return a plan with one row changed; what is said goes after what the row says."""
    row = plan.rows[effect]
    said = f"{row.reason}; {reason}" if reason else row.reason
    return replace(plan, rows={**plan.rows, effect: replace(row, reason=said, **changes)})
