"""Coarse presses of a scene, on which effects are tried and from which errors are estimated.

Each is the scene's own press on longer edges, which costs a small part of it. They are kept by
scene, since plan and error estimate share them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache

from sim.effects.effect_plan import EffectPlan, full_plan
from sim.effects.outputs import PressOutputs, outputs_of
from sim.effects.scene_path import follow, path_for
from sim.scene.scene import Preset, Scene
from tacauchy_rig.core.long_task import doing

# How many times shorter than the scene's the edges are, the coarsest first. Preset paper has but
# one mesh.
COARSE_RATIOS: dict[Preset, tuple[float, ...]] = {
    Preset.FAST: (0.5,),
    Preset.BALANCED: (1.0 / 3.0, 0.5),
    Preset.ACCURATE: (1.0 / 3.0, 0.5),
    Preset.REFERENCE: (1.0 / 3.0, 0.5),
    Preset.PAPER: (),
}
_KEPT = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarsePress:
    """A press on longer edges.

    Attributes:
        ratio: How many times shorter than the scene's its edges are.
        processor_s: What it cost [s].
    """

    ratio: float
    outputs: PressOutputs
    processor_s: float


def coarse_press(scene: Scene, plan: EffectPlan, ratio: float) -> CoarsePress:
    """Press a scene with a plan's effects on longer edges, at most as short as its way's.

    Raises:
        RigError: It cannot be meshed or solved there.
    """
    # Without what does not change a press on given edges, so that more scenes share it.
    bare = replace(scene, effects=plan.switches, tolerance=None, outputs=frozenset(), sensor="")
    if scene.path_refinement is not None:
        ratio = min(ratio, scene.path_refinement / scene.refinement)
    return _pressed(replace(bare, path_refinement=None), ratio)


def forget() -> None:
    """Forget every coarse press, so that the next ones are timed."""
    _pressed.cache_clear()


class CoarsePath:
    """A scene's path on longer edges, pushed from force to force.

    Args:
        ratio: How many times shorter than the scene's its edges are.

    Raises:
        RigError: It cannot be meshed.
    """

    def __init__(self, scene: Scene, plan: EffectPlan, ratio: float) -> None:
        self._ratio = ratio
        self._path = path_for(replace(scene, refinement=ratio * scene.refinement), plan)

    def push(self, force_n: float) -> CoarsePress:
        """Push on to a force [N].

        Raises:
            ConvergenceError: It cannot be reached.
        """
        started = time.process_time()
        outputs = outputs_of(self._path, self._path.push(force_n))
        spent = time.process_time() - started
        return CoarsePress(ratio=self._ratio, outputs=outputs, processor_s=spent)


@lru_cache(maxsize=_KEPT)
def _pressed(scene: Scene, ratio: float) -> CoarsePress:
    started = time.process_time()
    coarse = replace(scene, refinement=ratio * scene.refinement)
    plan = full_plan(coarse)
    with doing("a coarse press, to choose effects and estimate errors"):
        path = path_for(coarse, plan)
        outputs = outputs_of(path, follow(coarse, path))
    return CoarsePress(ratio=ratio, outputs=outputs, processor_s=time.process_time() - started)
