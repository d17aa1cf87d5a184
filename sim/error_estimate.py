"""Estimated errors of a press, and the cheapest settings that keep a tolerance.

Where an output changes by d when every edge becomes twice as long, and its error falls with the
edge length to the power of two, a third of d is left (Richardson 1911; as an uncertainty with a
factor of safety: Roache 1994, the grid convergence index). Meshes are not nested here, and with the
edges the sectors change: the contact's edge cuts other elements. That and a wide barrier add a part
that no extrapolation sees:

    error = slope |d| + rest / refinement^2 + share x

with three numbers for each output, fitted so that nine drawn presses in ten have a smaller error. x
is d_hat over the depth, for the barrier. A rim cuts edges otherwise than a ball does.

Of shear, d is the change of its field with longer edges, face by face, over the root of the number
of touched faces: the faces err independently, and the stated error is a norm over all. It is so
under balls and rims, on every preset. d counts by the share of mu that is left: where all slides no
mesh changes the shear, and without friction there is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sim.effects.effect_choice import plan_effects
from sim.effects.planned_effects import EffectPlan, full_plan
from sim.effects.press_outputs import PressOutputs
from sim.effects.press_with_effects import COARSE_RATIOS, CoarsePress, coarse_press
from sim.mesh_bias_correction import RelativeCost, Setting, corrected_settings
from sim.scene.indenter import Sphere
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from tacauchy_rig.core.errors import ConfigError, ConvergenceError, RigError, TimeLimitError
from tacauchy_rig.core.quantities import UNITS, Dimension, parse_quantity, split_quantity
from tacauchy_rig.core.simulated import Alternative

# (slope, rest, share), against what edges two thirds as long tend to
# (docs/explanation/accuracy.md): on preset fast force, pressure and markers from 94 drawn presses,
# image from 166; finer ones from 34; shear on all presets from 530 that grip. Pressure on finer
# ones is a fifth wider than that: it was short in more than one of ten of 29 other presses.
_Rule = dict[Output, tuple[float, float, float]]
_SHEAR: _Rule = {Output.SHEAR: (6.3, 0.0015, 0.0)}
_EITHER: _Rule = {**_SHEAR, Output.FORCE: (0.1, 0.04, 0.0), Output.DEPTH: (0.4, 0.02, 0.0)}
_UNDER_BALL: _Rule = {
    **_EITHER,
    Output.PRESSURE: (0.2, 0.08, 0.1),
    Output.IMAGE: (0.3, 0.025, 0.0),
    Output.MARKERS: (0.1, 0.07, 0.4),
}
_UNDER_RIM: _Rule = {
    **_EITHER,
    Output.PRESSURE: (0.5, 0.31, 0.0),
    Output.IMAGE: (0.2, 0.02, 1.0),
    Output.MARKERS: (0.4, 0.05, 0.0),
}
_FINER: _Rule = {
    **_SHEAR,
    Output.FORCE: (0.2, 0.004, 0.0),
    Output.DEPTH: (0.4, 0.003, 0.0),
    Output.PRESSURE: (1.25, 0.025, 0.0),
    Output.IMAGE: (0.6, 0.011, 0.0),
    Output.MARKERS: (0.6, 0.006, 0.0),
}
_FINER_RIM: _Rule = {**_FINER, Output.PRESSURE: (1.25, 0.125, 0.0)}
# Linear tetrahedra lock on coarser meshes too, and preset paper has but one: they are held against
# preset fast's quadratic ones on edges a third longer, which err by this much in one of ten.
_LINEAR_RATIO, _LINEAR_ERROR = 0.75, 0.12
# Larger changes are no longer a sign of how the error falls: where a gel slips past a sharp rim in
# jumps, each mesh jumps at another depth. There the whole change is stated.
_FITTED = {Output.FORCE: 0.25, Output.DEPTH: 0.15}
# Of the pad's height: the presses that the rules were fitted to went no deeper.
_FITTED_SHARE = 0.5
_OF_THE_MESH = {Effect.SYMMETRY, Effect.LOCKING_FREE_ELEMENT}


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorEstimate:
    """Estimated errors of a press."""

    # Relative error of each output; of shear over the pressure. Empty where nothing is known;
    # ``basis`` says how it is known, or why not.
    relative: dict[Output, float]
    basis: str
    # The press on longer edges has failed, and not for want of time
    has_failed: bool = False

    @property
    def force(self) -> float | None:
        """Relative error of F_z, or None where nothing is known."""
        return self.relative.get(Output.FORCE)

    def beyond_rules(
        self, scene: Scene, *, depth_m: float, gap: float, ratio_min: float
    ) -> ErrorEstimate:
        """Return these, with the gap of a press that went deeper than those of the rules.

        Args:
            depth_m: How deep it went [m].
            gap: How far the gel's stress misses the indenter's force, relative to it.
            ratio_min: Smallest volume ratio in the gel.

        Raises:
            ConvergenceError: An error was asked for, and nothing tells that of so deep a press.
        """
        most_m = _FITTED_SHARE * scene.pad.height_m
        if isinstance(scene.indenter, Sphere):  # farther down its side overhangs
            most_m = min(most_m, scene.indenter.radius_m)
        if self is NOT_ASKED or depth_m <= most_m:
            return self
        if self.has_failed or ratio_min <= 0.0:
            why = self.basis if self.has_failed else f"gel is inside out (det F {ratio_min:.3f})"
            raise ConvergenceError(
                f"at {depth_m * 1e3:.4f} mm nothing tells the error: errors are known to "
                f"{most_m * 1e3:.4g} mm, and {why}",
                remedy="press less deep, or take a finer --preset",
            )
        more = {output: each and each + gap for output, each in self.relative.items()}
        basis = f"{self.basis}, {gap:.2%} between sigma n and the force"
        return replace(self, relative=more, basis=basis)


NOT_ASKED = ErrorEstimate(relative={}, basis="no error was asked for")


def coarse_reference(scene: Scene, plan: EffectPlan) -> tuple[Scene, EffectPlan, float]:
    """Return what a press is held against: scene, plan, and how many times shorter its edges."""
    if plan.is_on(Effect.LOCKING_FREE_ELEMENT):
        return scene, plan, COARSE_RATIOS[scene.preset][-1]
    kept = tuple((effect, on) for effect, on in plan.switches if effect not in _OF_THE_MESH)
    on_fast = replace(scene, preset=Preset.FAST, refinement=1.0, effects=kept)
    return on_fast, full_plan(on_fast), _LINEAR_RATIO


def guaranteed(scene: Scene) -> Output:
    """Return what a tolerance holds for: the force at a given depth, or the depth at a force."""
    return Output.FORCE if scene.target.force_n is None else Output.DEPTH


def estimated(
    scene: Scene, plan: EffectPlan, found: PressOutputs, *, way: PressOutputs | None = None
) -> ErrorEstimate:
    """Press a scene on longer edges and estimate the errors of the outputs of a press.

    Args:
        way: Of the mesh of the way, where that is another: it serves instead.
    """
    if way is not None and scene.path_refinement is not None:
        ratio = scene.path_refinement / scene.refinement
        coarse = CoarsePress(ratio=ratio, outputs=way, processor_s=0.0)
        return estimate_from(scene, plan, found, coarse)
    try:
        coarse = coarse_press(*coarse_reference(scene, plan))
    except RigError as error:
        return failed(error)
    return estimate_from(scene, plan, found, coarse)


def failed(error: RigError) -> ErrorEstimate:
    """Return the estimate where there is none, as a coarse press failed."""
    return ErrorEstimate(
        relative={},
        basis=f"the same press on longer edges failed: {error.message}",
        has_failed=not isinstance(error, TimeLimitError),
    )


def estimate_from(
    scene: Scene, plan: EffectPlan, found: PressOutputs, coarse: CoarsePress
) -> ErrorEstimate:
    """Return the errors of the outputs of a press, estimated from those of a coarse one.

    A press to a force has its error in its depth: F_z's is the force that this error amounts to.
    """
    if not found.force_n[2] > 0.0:
        return ErrorEstimate(relative={}, basis="there is no force to be wrong about")
    changes = coarse.outputs.changes(found)
    if plan.is_on(Effect.LOCKING_FREE_ELEMENT):  # those that lock err alike in all faces
        each = coarse.outputs.shear_change(found) / math.sqrt(found.touched_count)
        if scene.contact is ContactMode.FRICTION and scene.friction:  # by what is left of mu
            each *= max(0.0, 1.0 - found.sizes[Output.SHEAR] / scene.friction)
        changes[Output.SHEAR] = each
    rule, refinement = _FINER, scene.refinement
    is_ball = isinstance(scene.indenter, Sphere)
    if not plan.is_on(Effect.LOCKING_FREE_ELEMENT):
        rule, refinement = dict.fromkeys(Output, (1.0, _LINEAR_ERROR, 0.0)), 1.0
    elif scene.preset is Preset.FAST:
        rule = _UNDER_BALL if is_ball else _UNDER_RIM
    elif not is_ball:
        rule = _FINER_RIM
    gap = scene.contact_distance_m / max(found.depth_m, scene.contact_distance_m)
    relative = {}
    for output in Output:
        slope, (_, rest, share) = _slope_of(rule, output, changes), rule[output]
        of_the_mesh = slope * changes[output] + rest / refinement**2 + share * gap
        relative[output] = of_the_mesh + plan.left_out(output)
    if scene.contact is ContactMode.FRICTIONLESS:
        relative[Output.SHEAR] = 0.0
    # Where a load falls, it came to another equilibrium; another mesh may have kept the first one.
    fell = max(found.fell_relative, coarse.outputs.fell_relative)
    relative[Output.FORCE] += fell
    if scene.target.force_n is None:
        del relative[Output.DEPTH]
    else:
        share = found.stiffness_n_m * found.depth_m / float(found.force_n[2])
        relative[Output.FORCE] = max(1.0, share) * relative[Output.DEPTH]
    judged = guaranteed(scene)
    slope, rest = _slope_of(rule, judged, changes), rule[judged][1]
    basis = (
        f"Richardson: edges {1.0 / coarse.ratio:.3g} times as long change the {judged.value} by "
        f"{changes[judged]:.2%}; {slope:g} times that and {rest / refinement**2:.2%}"
    )
    if fell and judged is Output.FORCE:
        basis += f", {fell:.2%} by which it fell in a load step"
    omitted = plan.estimated_error
    return ErrorEstimate(
        relative=relative,
        basis=f"{basis}, {omitted:.2%} for effects left out" if omitted else basis,
    )


def _slope_of(rule: _Rule, output: Output, changes: dict[Output, float]) -> float:
    """Return how many times an output's change counts as its error."""
    is_fitted = changes[output] <= _FITTED.get(output, math.inf)
    return rule[output][0] if is_fitted else max(1.0, rule[output][0])


def _fast(refinement: float) -> Setting:
    return Setting(Preset.FAST, refinement)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How far off F_z may be: relative to F_z, or in newtons; exactly one of the two."""

    relative: float | None = None
    force_n: float | None = None  # of the largest force where there are several [N]

    def __post_init__(self) -> None:
        value = self.relative if self.force_n is None else self.force_n
        if (self.relative is None) == (self.force_n is None) or value is None or not value > 0.0:
            raise ConfigError(
                f"a tolerance of {value} is none", remedy="write it as 0.02N or 1%, above 0"
            )

    def of(self, force_n: float) -> float:
        """Return the tolerance relative to a force [N]; infinite for none."""
        if self.force_n is None:
            return self.relative or 0.0
        return self.force_n / force_n if force_n > 0.0 else float("inf")

    def __str__(self) -> str:
        return (
            f"{1e2 * (self.relative or 0.0):g}% of F_z"
            if self.force_n is None
            else f"{self.force_n:g} N"
        )


def parse_tolerance(text: str, *, field: str) -> Tolerance:
    """Read ``0.02N`` or ``1%``; a number without a unit could be meant as either.

    Raises:
        ConfigError: Neither a force nor a share in percent, or not above zero.
    """
    parts = split_quantity(text)
    unit = "" if parts is None else parts[1]
    is_force = unit in UNITS[Dimension.FORCE]
    if not is_force and unit != "%":
        problem = "is no tolerance" if parts is None or unit else "has no unit"
        raise ConfigError(f'{field}: "{text}" {problem}', remedy="give 0.02N or 1%")
    dimension = Dimension.FORCE if is_force else Dimension.RATIO
    value = parse_quantity(text, dimension=dimension, field=field)
    return Tolerance(force_n=value) if is_force else Tolerance(relative=value)


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
        error, force = _error_on_fast(fast)
    except TimeLimitError:
        raise
    except RigError as failure:
        raise ConfigError(
            f"no preset is known to keep {tolerance} here: {failure.message}",
            remedy="choose a preset instead",
        ) from failure
    allowed = tolerance.of(force)
    believed = {setting: worth.error_ratio * error for setting, worth in RELATIVE_COSTS.items()}
    cheapest = _cheapest(scene, believed, allowed)
    if cheapest is not None:
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

    Where no bias is known, or none leaves so little, the raw force is to keep it.

    Raises:
        ConfigError: No settings keep it.
    """
    return corrected_scene(scene, tolerance) or keeping(scene, tolerance)


def corrected_scene(scene: Scene, tolerance: Tolerance) -> Scene | None:
    """Return a scene with the cheapest settings whose bias is known and keeps a tolerance."""
    stated = {each: worth.error_ratio for each, worth in corrected_settings(scene).items()}
    allowed = _allowed(next(iter(stated)).applied(scene), tolerance) if stated else 0.0
    return _cheapest(scene, stated, allowed)


def _cheapest(scene: Scene, errors: dict[Setting, float], allowed: float) -> Scene | None:
    """Return a scene with the first setting that errs by so little; effects get what it leaves."""
    for setting, own in errors.items():
        if own <= allowed:
            return replace(setting.applied(scene), tolerance=allowed - own)
    return None


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


def _error_on_fast(fast: Scene) -> tuple[float, float]:
    """Return the relative error of F_z on preset fast, and F_z [N]; refuse what does not touch."""
    plan = plan_effects(fast)
    own, coarse = coarse_press(fast, plan, 1.0), coarse_press(*coarse_reference(fast, plan))
    worth = estimate_from(fast, plan, own.outputs, coarse)
    if worth.force is None:
        raise ConfigError(worth.basis, remedy="press deeper")
    return worth.force, float(own.outputs.force_n[2])


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
