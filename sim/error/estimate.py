"""Estimated errors of a press, from the same press on longer edges.

Where an output changes by d when every edge becomes twice as long, and its error falls with the
edge length to the power of two, a third of d is left (Richardson 1911; as an uncertainty with a
factor of safety: Roache 1994, the grid convergence index). Meshes are not nested here, and with the
edges the sectors go: what a contact's edge happens to cut, and a wide barrier, add a part that no
extrapolation sees:

    error = slope |d| + rest / refinement^2 + share x

with three numbers for each output, laid so that nine drawn presses in ten err by less. x is d_hat
over the depth, for the barrier. A rim cuts edges otherwise than a ball does.

Of shear d is what longer edges change in its field, face by face, over the root of how many faces
are touched: each errs for itself, and what is stated is a norm over all. It is so under balls and
rims, on every preset. d counts by the share of mu that is left: where all slides no mesh changes
the shear, and without friction there is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sim.effects.coarse import RUNGS, CoarsePress, coarse_press
from sim.effects.effect_plan import EffectPlan, everything
from sim.effects.outputs import PressOutputs
from sim.scene.indenter import Sphere
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from tacauchy_rig.core.errors import RigError

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
_OF_THE_MESH = {Effect.SYMMETRY, Effect.LOCKING_FREE_ELEMENT}


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorEstimate:
    """Estimated errors of a press.

    Attributes:
        relative: Relative error of each output; of shear over the pressure. Empty where nothing is
            known; ``basis`` says how it is known, or why not.
    """

    relative: dict[Output, float]
    basis: str

    @property
    def force(self) -> float | None:
        """Relative error of F_z, or None where nothing is known."""
        return self.relative.get(Output.FORCE)


NOT_ASKED = ErrorEstimate(relative={}, basis="no error was asked for")


def rung(scene: Scene, plan: EffectPlan) -> tuple[Scene, EffectPlan, float]:
    """Return what a press is held against: scene, plan, and how many times shorter its edges."""
    if plan.is_on(Effect.LOCKING_FREE_ELEMENT):
        return scene, plan, RUNGS[scene.preset][-1]
    kept = tuple((effect, on) for effect, on in plan.switches if effect not in _OF_THE_MESH)
    on_fast = replace(scene, preset=Preset.FAST, refinement=1.0, effects=kept)
    return on_fast, everything(on_fast), _LINEAR_RATIO


def estimated(scene: Scene, plan: EffectPlan, found: PressOutputs) -> ErrorEstimate:
    """Press a scene on longer edges and estimate the errors of the outputs of a press."""
    try:
        coarse = coarse_press(*rung(scene, plan))
    except RigError as error:
        return failed(error)
    return estimate_from(scene, plan, found, coarse)


def failed(error: RigError) -> ErrorEstimate:
    """Return the estimate where there is none, as a coarse press failed."""
    return ErrorEstimate(
        relative={}, basis=f"the same press on longer edges failed: {error.message}"
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
        changes[Output.SHEAR] = each * _grip_left(scene, found)
    rule, refinement = _rule(scene, plan)
    gap = scene.contact_distance_m / max(found.depth_m, scene.contact_distance_m)
    relative = {}
    for output in Output:
        slope, rest, share = rule[output]
        of_the_mesh = slope * changes[output] + rest / refinement**2 + share * gap
        relative[output] = of_the_mesh + plan.left_out(output)
    if scene.contact is ContactMode.FRICTIONLESS:
        relative[Output.SHEAR] = 0.0
    if scene.target.force_n is None:
        del relative[Output.DEPTH]
    else:
        share = found.stiffness_n_m * found.depth_m / float(found.force_n[2])
        relative[Output.FORCE] = max(1.0, share) * relative[Output.DEPTH]
    judged = Output.FORCE if scene.target.force_n is None else Output.DEPTH
    slope, rest, _ = rule[judged]
    basis = (
        f"Richardson: edges {1.0 / coarse.ratio:.3g} times as long change the {judged.value} by "
        f"{changes[judged]:.2%}; {slope:g} times that and {rest / refinement**2:.2%}"
    )
    omitted = plan.estimated_error
    return ErrorEstimate(
        relative=relative,
        basis=f"{basis}, {omitted:.2%} for effects left out" if omitted else basis,
    )


def _rule(scene: Scene, plan: EffectPlan) -> tuple[_Rule, float]:
    """Return by what a scene's outputs err, and how many times shorter its edges are."""
    if not plan.is_on(Effect.LOCKING_FREE_ELEMENT):
        return dict.fromkeys(Output, (1.0, _LINEAR_ERROR, 0.0)), 1.0
    is_ball = isinstance(scene.indenter, Sphere)
    if scene.preset is not Preset.FAST:
        return _FINER if is_ball else _FINER_RIM, scene.refinement
    return _UNDER_BALL if is_ball else _UNDER_RIM, scene.refinement


def _grip_left(scene: Scene, found: PressOutputs) -> float:
    """Return the share of mu that the shear leaves; all of it where nothing slides."""
    if scene.contact is not ContactMode.FRICTION or not scene.friction:
        return 1.0
    return max(0.0, 1.0 - found.sizes[Output.SHEAR] / scene.friction)
