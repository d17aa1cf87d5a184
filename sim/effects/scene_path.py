"""The path of a scene's indenter with the effects of a plan, on its own mesh or a coarser one."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from sim.effects.effect_plan import EffectPlan, full_plan
from sim.effects.estimates import expected_depth, most_force
from sim.effects.outputs import PressOutputs, outputs_of
from sim.effects.presets import build_model, regularised_indenter
from sim.scene.indenter import tilted
from sim.scene.scene import ContactMode, Drive, Effect, Output, Preset, Scene
from sim.solve.equilibrium import SolverOptions
from sim.solve.force_search import find_force
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.model import Model
from sim.solve.nodal_energies import Inertia, weight
from sim.solve.path_point import PathPoint
from sim.solve.stepping import STEP_SHARE
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.long_task import doing

# Residual over the contact force of a press with a wide barrier; where a tolerance is asked for, a
# thousandth of it, at most, and a load is then met no closer than that.
_ROUGHLY, _ROUGHER, _OF_TOLERANCE = 1e-6, 1e-5, 1e-3
# What depends on the way that points slide or take hold. Where it is asked for, steps are so many
# times shorter: three balls' shear with mu 0.5 is then 0.2 to 0.6 % of the pressure off, not 0.8 to
# 2.0 %, for 1.3 to 1.8 times the time.
_PATH_DEPENDENT = {Output.SHEAR, Output.MARKERS}
_PATH_DEPENDENT_STEPS = 4.0
# So many steps at least, and as many as this over the tolerance. Gel under a ball 2 % deep moves
# otherwise by 18 % in two steps than in sixty, by 4 % in ten and by 1.4 % in twenty.
_STEPS_LEAST, _STEPS_BY_TOLERANCE = 10.0, 0.6
# Time steps of a press, and of a motion, with inertia.
TIME_STEPS = 60


def path_for(
    scene: Scene,
    plan: EffectPlan,
    *,
    model: Model | None = None,
    refinement: float = 1.0,
    keeps_all: bool = False,
    device: str = "cpu",
) -> LoadingPath:
    """Return the path that a scene's indenter will go, with the planned effects.

    A model is reused; without one the scene is meshed, every edge ``refinement`` times shorter.

    Raises:
        ConfigError: The scene cannot be built, or its force is far beyond what the gel carries.
    """
    force_n = scene.target.force_n
    if force_n is not None and force_n > most_force(scene):
        raise ConfigError(
            f"a force of {force_n:g} N is more than the gel can carry: by a coarse estimate less "
            f"than {most_force(scene):.3g} N press the indenter to its base",
            remedy="press with less force",
        )
    if model is None:
        with doing("meshing"):
            model = build_model(scene, plan=plan, refinement=refinement, device=device)
    densities = np.array([material.density_kg_m3 for material in scene.materials])
    density = densities[model.mesh.labels]
    step_s = scene.duration_s / TIME_STEPS
    return LoadingPath(
        model,
        regularised_indenter(scene, refinement=refinement),
        scene.centre_m,
        rotation=tilted(*scene.motion.tilt_rad),
        step_max_m=_longest_step(scene, plan, height_m=model.height_m),
        potentials=(weight(model, density),) if plan.is_on(Effect.GRAVITY) else (),
        inertia=Inertia(model, density, step_max_s=step_s) if plan.is_on(Effect.INERTIA) else None,
        options=_options(scene),
        keeps_all=keeps_all,
    )


def _longest_step(scene: Scene, plan: EffectPlan, *, height_m: float) -> float:
    """Return how far the indenter goes in a step at most [m]."""
    longest, asked = STEP_SHARE * height_m, _PATH_DEPENDENT & scene.outputs
    holds = scene.contact is ContactMode.BONDED or plan.is_on(Effect.FRICTION)
    if not asked or not holds:
        return longest
    closest = min(plan.tolerances.get(output, 1.0) for output in asked)
    steps = max(_STEPS_LEAST, _STEPS_BY_TOLERANCE / closest)
    return min(longest / _PATH_DEPENDENT_STEPS, expected_depth(scene) / steps)


def _options(scene: Scene) -> SolverOptions:
    """Return how closely a scene's forces are to balance."""
    if not scene.has_wide_barrier:
        return SolverOptions()
    if scene.tolerance is None:
        return SolverOptions(residual_relative=_ROUGHLY)
    share = min(_ROUGHER, max(_ROUGHLY, _OF_TOLERANCE * scene.tolerance))
    return SolverOptions(residual_relative=share, load_relative=share)


def follow(scene: Scene, path: LoadingPath) -> PathPoint:
    """Take the indenter to the scene's depth or force, then along its motion.

    Returns:
        The end; its stiffness is that of the way down, as what slides under a load sinks anyhow.

    Raises:
        ConvergenceError: No equilibrium, or the force cannot be reached.
        ConfigError: The depth is more than the gel has room for.
    """
    depth, force = scene.target.depth_m, scene.target.force_n
    if depth is not None:
        point = path.advance(depth, duration_s=scene.duration_s)
    elif scene.drive is Drive.LOAD:
        point = path.push(force or 0.0, duration_s=scene.duration_s)
    else:
        point = find_force(path, force or 0.0, tolerance_n=scene.force_tolerance_n).point
    motion = scene.motion
    if any(motion.shift_m) or motion.twist_rad:
        carried = path.carry(
            shift_m=motion.shift_m,
            twist_rad=motion.twist_rad,
            hold=Hold.DEPTH if depth is not None else Hold.FORCE,
            duration_s=scene.duration_s,
        )
        return replace(carried, stiffness_n_m=point.stiffness_n_m)
    return point


# Effects are tried on the scene's own press on longer edges, and errors estimated from it, which
# costs a small part of it. How many times shorter the edges are, the coarsest first; preset paper
# has but one mesh.
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
    """A press on longer edges."""

    ratio: float  # how many times shorter than the scene's its edges are
    outputs: PressOutputs
    processor_s: float  # what it cost [s]


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
    """A scene's path on edges ``ratio`` times shorter, pushed from force to force."""

    def __init__(self, scene: Scene, plan: EffectPlan, ratio: float) -> None:
        self._ratio = ratio
        self._path = path_for(replace(scene, refinement=ratio * scene.refinement), plan)

    def push(self, force_n: float) -> CoarsePress:
        """Push on to a force [N]."""
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
