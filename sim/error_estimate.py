"""Estimated errors of a press: slope |d| + rest / refinement^2 + share d_hat / depth.

docs/explanation/accuracy.md describes the terms; d is an output's change with edges twice as long.
The three numbers for each output were fitted so that nine drawn presses in ten have a smaller
error. Meshes are not nested, and with the edges the sectors change: the contact's edge cuts other
elements, a rim otherwise than a ball.

Of shear, d is the change of its field with longer edges, face by face, over the root of the number
of touched faces: the faces err independently, and the stated error is a norm over all. It is so
under balls and rims, on every preset. d counts by the share of mu that is left: where all slides no
mesh changes the shear, and without friction there is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sim.effects.planned_effects import EffectPlan, full_plan
from sim.effects.press_outputs import PressOutputs
from sim.effects.press_with_effects import COARSE_RATIOS, CoarsePress, coarse_press
from sim.mesh_bias_correction import fold_error
from sim.scene.indenter import Sphere
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from tacauchy_rig.core.errors import ConvergenceError, RigError, TimeLimitError

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
        self, scene: Scene, depth_m: float, gap: float, ratio_min: float, *, at_rim: bool = False
    ) -> ErrorEstimate:
        """Return these, with the gap of a press that went deeper than those of the rules.

        Args:
            depth_m: How deep it went [m].
            gap: How far the gel's stress misses the indenter's force; added ``at_rim`` as well.
            ratio_min: Smallest volume ratio in the gel.

        Raises:
            ConvergenceError: An error was asked for, and nothing tells that of so deep a press.
        """
        most_m = _FITTED_SHARE * scene.pad.height_m
        if isinstance(scene.indenter, Sphere):  # farther down its side overhangs
            most_m = min(most_m, scene.indenter.radius_m)
        if self is NOT_ASKED or not (at_rim or depth_m > most_m):
            return self
        if depth_m > most_m and (self.has_failed or ratio_min <= 0.0):
            why = self.basis if self.has_failed else f"gel is inside out (det F {ratio_min:.3f})"
            raise ConvergenceError(
                f"at {depth_m * 1e3:.4f} mm nothing tells the error: errors are known to "
                f"{most_m * 1e3:.4g} mm, and {why}",
                remedy="press less deep, or take a finer --preset",
            )
        more = {output: each and each + gap for output, each in self.relative.items()}
        basis = f"{self.basis} + {gap:.2%} (force gap)"
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
    try:
        if way is None or scene.path_refinement is None:
            coarse = coarse_press(*coarse_reference(scene, plan))
        else:
            coarse = CoarsePress(ratio=scene.path_refinement / scene.refinement, outputs=way)
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
    relative, judged, basis = {}, guaranteed(scene), ""
    for output, change in changes.items():
        slope, rest, share = rule[output]
        if change > _FITTED.get(output, math.inf):
            slope = max(1.0, slope)
        if output is judged:
            basis = (
                f"Richardson: edges {1.0 / coarse.ratio:.3g} times as long change the "
                f"{output.value} by {change:.2%}; {slope:g} * {change:.2%} + "
                f"{rest / refinement**2:.2%}"
            )
        of_the_mesh = slope * change + rest / refinement**2 + share * gap
        relative[output] = of_the_mesh + plan.left_out(output)
    if scene.contact is ContactMode.FRICTIONLESS:
        relative[Output.SHEAR] = 0.0
    # Where a load falls, it came to another equilibrium; another mesh may have kept the first one.
    fell = max(found.fell_relative, coarse.outputs.fell_relative)
    relative[Output.FORCE] = max(relative[Output.FORCE] + fell, fold_error(scene))
    if scene.target.force_n is None:
        del relative[Output.DEPTH]
    else:
        share = found.stiffness_n_m * found.depth_m / float(found.force_n[2])
        relative[Output.FORCE] = max(1.0, share) * relative[Output.DEPTH]
    if fell and judged is Output.FORCE:
        basis += f" + {fell:.2%} (fall in a load step)"
    omitted = plan.estimated_error
    return ErrorEstimate(
        relative=relative, basis=f"{basis} + {omitted:.2%} (effects left out)" if omitted else basis
    )
