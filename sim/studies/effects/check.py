"""Scenes under their plans and with everything on: what was left out, what that changed."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources

from sim.effects.coarse import forget
from sim.effects.effect_plan import EffectPlan, full_plan
from sim.effects.outputs import PressOutputs, outputs_of
from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, path_for
from sim.error import estimated
from sim.press_command import scene_from
from sim.scene.material import RelaxationTerm
from sim.scene.scene import Effect, Output, Scene, Target

_TOUCH_M = 5e-6
# Kernels are the same on any mesh: they are loaded on a coarse one.
_TOUCH_REFINEMENT = 0.5
# What errors are judged by: everything on and edges so many times shorter, and what that tends
# to where an error falls with the edge length to the power of two.
_FINER = 1.5
# A size that is none; it keeps a quotient finite.
_NOTHING = 1e-300


@dataclass(frozen=True, slots=True)
class EffectCase:
    """A scene and what sets it apart."""

    name: str
    shows: str
    scene: Scene


def _case(
    name: str,
    shows: str,
    press: str,
    *,
    relaxation: Sequence[dict[str, float]] = (),
    density_kg_m3: float = 1000.0,
) -> EffectCase:
    """Return a case of ``cases.toml``; relaxation and density are no words of a press."""
    scene = scene_from(press)
    terms = tuple(RelaxationTerm(**term) for term in relaxation)
    material = replace(scene.material, relaxation=terms, density_kg_m3=density_kg_m3)
    return EffectCase(name, shows, replace(scene, material=material))


_FILE = resources.files("sim.studies.effects").joinpath("cases.toml")
EFFECT_CASES = tuple(_case(**each) for each in tomllib.loads(_FILE.read_text("utf-8"))["case"])


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCheck:
    """A scene under its plan and with everything on.

    Attributes:
        name: Of the scene; ``shows`` says what sets it apart.
        added: What was off and is on in the full press.
        tolerances: Of each output that is asked for.
        expected: What the plan said that each of them changes by.
        differences: What each changed by.
        errors: Of each output what the press states, and what finer meshes tell; empty where
            that was not asked.
        planned_s: Processor time of planning, meshing, pressing and estimating errors [s].
        tried_s: What of it went into trying effects [s].
        full_s: The same with everything on and nothing planned [s].
    """

    name: str
    shows: str
    added: tuple[Effect, ...]
    tolerances: dict[Output, float]
    expected: dict[Output, float]
    differences: dict[Output, float]
    errors: dict[Output, tuple[float, float]]
    planned_s: float
    tried_s: float
    full_s: float

    @property
    def shares(self) -> dict[Output, float]:
        """Difference over tolerance of each output that is asked for; above 1 is a miss."""
        return {each: found / self.tolerances[each] for each, found in self.differences.items()}

    @property
    def worst(self) -> tuple[Output, float]:
        """The output that came nearest to its tolerance or went furthest beyond, and its share."""
        return max(self.shares.items(), key=lambda item: item[1])

    @property
    def passed(self) -> bool:
        """Every output is within its tolerance."""
        return self.worst[1] <= 1.0

    @property
    def time_ratio(self) -> float:
        """Processor time of everything on over that of the plan."""
        return self.full_s / self.planned_s


def check_effects(case: EffectCase, *, errors: bool = False) -> EffectCheck:
    """Press a scene under its plan and with everything on.

    Args:
        errors: Judge the stated errors too, by a press on a finer mesh.

    Raises:
        ConvergenceError: A press has no equilibrium.
    """
    scene = case.scene
    every_effect = full_plan(scene)
    plan = plan_effects(scene)
    for each in {plan.switches, every_effect.switches}:
        _touch(scene, each)
    plan_effects.cache_clear()
    forget()
    started = time.process_time()
    plan = plan_effects(scene)
    planned = _pressed(scene, plan)
    stated = estimated(scene, plan, planned).relative
    planned_s = time.process_time() - started
    forget()
    started = time.process_time()
    full = _pressed(scene, every_effect)
    estimated(scene, every_effect, full)
    full_s = time.process_time() - started
    found, true = planned.differences(full), {}
    if errors:
        # What inertia changes follows from the press with everything on, at a fraction of the time.
        inertia = (Effect.INERTIA, plan.is_on(Effect.INERTIA))
        shorter = replace(
            scene, refinement=_FINER * scene.refinement, effects=(*scene.effects, inertia)
        )
        true = _true_errors(planned, full, _pressed(shorter, full_plan(shorter)))
    return EffectCheck(
        name=case.name,
        shows=case.shows,
        added=tuple(e for e, on in every_effect.switches if on and not plan.is_on(e)),
        tolerances=dict(plan.tolerances),
        expected={output: plan.left_out(output) for output in plan.tolerances},
        differences={output: found[output] for output in plan.tolerances},
        errors={each: (stated[each], true[each]) for each in stated if each in true},
        planned_s=planned_s,
        tried_s=plan.tried_s,
        full_s=full_s,
    )


def _true_errors(
    planned: PressOutputs, full: PressOutputs, finer: PressOutputs
) -> dict[Output, float]:
    """Return how far a press is from what everything on tends to where edges go to zero.

    Only the mesh's part is extrapolated: what is left out differs by as much on every mesh.
    """
    errors = {}
    for output, size in planned.sizes.items():
        coarse, fine = full.sizes[output], finer.sizes[output]
        limit = fine + (fine - coarse) / (_FINER**2 - 1.0)
        scale = 1.0 if output is Output.SHEAR else max(abs(limit), _NOTHING)
        errors[output] = abs(size - limit) / scale
    return errors


def _pressed(scene: Scene, plan: EffectPlan) -> PressOutputs:
    path = path_for(scene, plan)
    return outputs_of(path, follow(scene, path))


def _touch(scene: Scene, switches: tuple[tuple[Effect, bool], ...]) -> None:
    """Touch the gel once with some effects, so that loading kernels is not timed later."""
    still = tuple(
        (effect, on and effect is not Effect.INERTIA)
        for effect, on in switches
        if effect is not Effect.SYMMETRY  # which planes there are depends on the depth
    )
    bare = replace(
        scene,
        target=Target(depth_m=_TOUCH_M),
        refinement=_TOUCH_REFINEMENT * scene.refinement,
        effects=still,
    )
    _pressed(bare, full_plan(bare))
