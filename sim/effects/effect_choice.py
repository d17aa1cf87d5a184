"""Which effects a scene calls for: ``Scene`` in, ``EffectPlan`` out.

docs/explanation/effects.md says how. What is off is not compiled, not launched and not allocated.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

from sim.effects import depth_and_inertia_scales as estimates
from sim.effects.mesh_choice import is_cut
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
# Share of a press's time that leaving an effect out saves, and share that one more coarse press
# costs; medians of drawn scenes (`tacauchy-rig effects-check --random`). Small strains save
# nothing.
_SAVES = {Effect.FRICTION: 0.5, Effect.GRAVITY: 0.08, Effect.VISCOELASTICITY: 0.08}
_COSTS = {Preset.FAST: 0.15, Preset.BALANCED: 0.06, Preset.ACCURATE: 0.02, Preset.REFERENCE: 0.01}
# The same share where load steps have a mesh of their own: 0.4 to 0.8 in 11 drawn presses with
# friction, all of which needed it.
_COST_BESIDE_A_WAY = 0.6
# A fine press's difference is at most so many times that of its one coarse press (1.5 in F_z, 3.2
# in a field in 60 drawn presses). With two it is the finer one's and what the two are apart.
_ONE_COARSE, _ONE_COARSE_FIELDS = 2.0, 4.0
# Trying would only confirm that friction is needed where mu is so many tolerances of shear or
# markers: a straight press's tangential traction came out as 0.06 to 0.7 mu of the pressure, and a
# plan doubles what it finds.
_GRIPS = 1.0
# Of F_z: so little tells these apart. Without weight and inertia the forces of four tilted punches
# change by 0.1 to 0.9 %, and by 2.6 %, towards that of a fine mesh.
_APART = 0.02
_FOLDS = "a sharp rim this deep has several equilibria, between which the least effect chooses"
# A tolerance that is none; it keeps quotients finite.
_NOTHING = 1e-30
_Costs = dict[Output, float]  # relative errors


@lru_cache(maxsize=256)
def plan_effects(scene: Scene) -> EffectPlan:
    """Decide which effects of a scene are simulated, cached; errors are those of ``full_plan``."""
    plan = replace(full_plan(scene), tolerances=output_tolerances(scene))
    if plan.tolerances[Output.FORCE] <= _APART and estimates.has_several_equilibria(scene):
        for effect in (Effect.INERTIA, *_SAVES):
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
    for effect, saved in _SAVES.items():
        if _is_open(plan, effect):
            plan = _judged(scene, plan, effect, saved)
    return plan


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


def _judged(scene: Scene, plan: EffectPlan, effect: Effect, saved: float) -> EffectPlan:
    """Return a plan after an effect was tried, or was not as the share it saves cannot pay."""
    ratios = COARSE_RATIOS[scene.preset]
    price = len(ratios) * _COSTS.get(scene.preset, 0.0)
    if scene.path_refinement is not None:
        price = _COST_BESIDE_A_WAY
    why = _why_needed(scene, plan) if effect is Effect.FRICTION else ""
    if not ratios:
        why = why or "preset paper has one mesh"
    elif saved < price:
        why = why or f"trying costs {price:.0%} of a press's time and may save {saved:.0%}"
    if why:
        return _with(plan, effect, reason=f"on untried: {why}")
    try:
        costs, spent, count = _tried(scene, plan, effect)
    except TimeLimitError:
        raise
    except RigError as error:
        return _with(plan, effect, reason=f"on, as a coarse press failed: {error.message}")
    plan = replace(plan, tried_s=plan.tried_s + spent)
    edges = " and ".join(f"{1.0 / ratio:g}" for ratio in ratios[:count])
    return _weighed(plan, effect, costs, f"tried on edges {edges} times as long")


def _why_needed(scene: Scene, plan: EffectPlan) -> str:
    """Say why a scene needs its friction without a try, or nothing."""
    if scene.motion.moves:
        return "the indenter moves along the gel"
    if is_cut(scene) or is_cut(scene, slides=False):
        return "an acute corner this deep cuts gel that slides"
    for output in (Output.SHEAR, Output.MARKERS):
        allowed = plan.tolerances.get(output)
        if allowed is not None and scene.friction > _GRIPS * allowed:
            return f"{output.value} is asked for to {allowed:.1%}, and mu is {scene.friction:g}"
    return ""


def _tried(scene: Scene, plan: EffectPlan, effect: Effect) -> tuple[_Costs, float, int]:
    """Return what leaving an effect out costs each output, the processor's time [s], and meshes."""
    without = _with(plan, effect, on=False)
    found, spent = [], 0.0
    for ratio in COARSE_RATIOS[scene.preset]:
        pressed = [coarse_press(scene, each, ratio) for each in (without, plan)]
        spent += sum(each.processor_s for each in pressed)
        found.append(pressed[0].outputs.differences(pressed[1].outputs))
        if any(plan.left_out(k) + found[0][k] > allowed for k, allowed in plan.tolerances.items()):
            break  # with a finer mesh costs would be no less
    coarse, fine = found[0], found[-1]
    if len(COARSE_RATIOS[scene.preset]) > 1:
        costs = {each: fine[each] + abs(fine[each] - coarse[each]) for each in fine}
    else:
        costs = {k: (_ONE_COARSE if k in _SUMS else _ONE_COARSE_FIELDS) * fine[k] for k in fine}
    return costs, spent, len(found)


def _weighed(plan: EffectPlan, effect: Effect, costs: _Costs, basis: str) -> EffectPlan:
    """Leave an effect out if that keeps every tolerance, with what is left out already."""
    sums = {output: plan.left_out(output) + costs[output] for output in plan.tolerances}
    worst = max(sums, key=lambda output: sums[output] / max(plan.tolerances[output], _NOTHING))
    on = sums[worst] > plan.tolerances[worst]
    reason = (
        f"{basis}; with all that is left out {worst.value} {'would be' if on else 'is'} "
        f"{sums[worst]:.2%} off, {plan.tolerances[worst]:.2%} allowed"
    )
    return _with(plan, effect, on=on, costs=costs, reason=reason)


def _with(plan: EffectPlan, effect: Effect, *, reason: str = "", **changes: Any) -> EffectPlan:
    """Return a plan with one row changed; what is said goes after what the row says."""
    row = plan.rows[effect]
    said = f"{row.reason}; {reason}" if reason else row.reason
    return replace(plan, rows={**plan.rows, effect: replace(row, reason=said, **changes)})
