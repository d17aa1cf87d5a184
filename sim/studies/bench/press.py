"""One scene pressed in frames, and timed."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from sim.correction import correction
from sim.effects.end_state import carried_over, has_own_way, way_of
from sim.effects.outputs import outputs_of
from sim.effects.plan import PRESET_TOLERANCE, plan_effects
from sim.effects.scene_path import path_for
from sim.error import keeping, keeping_corrected, parse_tolerance
from sim.press import measure
from sim.press_command import scene_from
from sim.scene.scene import Preset, Scene
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.path_point import PathPoint
from sim.studies.bench.batches import press_batch, pressing_frames
from sim.studies.bench.scenes import FRAME_COUNT, Manner, ScenePress
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.core.errors import ConfigError

# The least of so many presses counts, if they do not take longer than this together [s].
_REPEATS, _ENOUGH_S = 3, 6.0
# Of the way, for what compiles or loads the kernels.
_WARM_SHARE = 0.1
# The preset where no setting states a tolerance: the first whose usual error is within it.
_UNPROMISED = ((0.03, Preset.FAST), (0.01, Preset.BALANCED), (0.0, Preset.ACCURATE))


def press_scene(stated: Mapping[str, Any], manner: Manner) -> ScenePress:
    """Press a line of the table.

    Raises:
        RigError: The scene cannot be built or pressed so.
    """
    alone = manner.environments is None
    scene, is_stated = within(stated_scene(stated), manner.tolerance, corrected=alone)
    if alone:
        return press_in_frames(scene, promised=is_stated, device=manner.device)
    return press_batch(scene, json.dumps(dict(stated)), manner)


def press_reference(stated: Mapping[str, Any], preset: str) -> ScenePress:
    """Press a line of the table once with a preset, for what others are compared with.

    Raises:
        RigError: The scene cannot be built or pressed so.
    """
    return press_in_frames(replace(stated_scene(stated), preset=Preset(preset)), is_timed=False)


def stated_scene(stated: Mapping[str, Any]) -> Scene:
    """Return the scene of a line of the table.

    Raises:
        ConfigError: An option is not understood.
    """
    given = {"sensor": "gelsight-mini", "indenter": "plane", **stated}
    triangles = given.pop("object", None)
    scene = scene_from(
        shlex.join(word for name, value in given.items() for word in (f"--{name}", str(value)))
    )
    return scene if triangles is None else replace(scene, indenter=OBJECTS[triangles]())


def within(scene: Scene, tolerance: str, *, corrected: bool = False) -> tuple[Scene, bool]:
    """Return a scene with the cheapest setting for a tolerance, and whether that states to keep it.

    Args:
        corrected: The corrected result is to keep it, not the raw force.

    Raises:
        ConfigError: The text is no tolerance.
    """
    allowed = parse_tolerance(tolerance, field="--tolerance")
    try:
        return (keeping_corrected if corrected else keeping)(scene, allowed), True
    except ConfigError:
        share = allowed.of(scene.target.force_n or float("inf"))
        preset = next(preset for least, preset in _UNPROMISED if share >= least)
        # What the plan goes by without a tolerance; the forces then balance as for one.
        return replace(scene, preset=preset, tolerance=PRESET_TOLERANCE[preset]), False


def press_in_frames(
    scene: Scene, *, promised: bool = False, device: str = "cpu", is_timed: bool = True
) -> ScenePress:
    """Press a scene in equal frames from the untouched gel on.

    Args:
        promised: Whether the setting states to keep the tolerance.
        device: Warp's.
        is_timed: Compile the kernels before, and press several times.

    Raises:
        ConvergenceError: A frame has no equilibrium.
        ConfigError: The scene cannot be built.
    """
    plan = plan_effects(scene)
    own_way = has_own_way(scene, plan)
    gone = way_of(scene) if own_way else scene
    started = time.perf_counter()
    way = path_for(gone, plan, device=device)
    path = path_for(scene, plan, device=device) if own_way else way
    setup_s = time.perf_counter() - started
    model, way_model = path.model, way.model
    if is_timed:
        # Every kernel of the press, in two other frames.
        for move in moves(scene, count=2, part=_WARM_SHARE):
            last = move(way)
        if own_way:
            path.resume(path.untouched(0.0), load_n=None, stiffness_n_m=last.stiffness_n_m)
    times: list[tuple[float, float]] = []
    repeats = _REPEATS if is_timed else 1
    while len(times) < repeats and sum(cpu for cpu, _ in times) < _ENOUGH_S:
        way = path_for(gone, plan, model=way_model)
        path = path_for(scene, plan, model=model) if own_way else way
        wall, cpu = time.perf_counter(), time.process_time()
        points = [move(way) for move in moves(scene)]
        stiffness = points[pressing_frames(scene) - 1].stiffness_n_m
        end = replace(points[-1], stiffness_n_m=stiffness)
        if own_way:
            end = carried_over(scene, way, end, path)
        times.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu_s, wall_s = min(times)
    corrected = None
    if own_way:
        coarse = replace(points[-1], stiffness_n_m=stiffness)
        corrected = correction(scene, plan, outputs_of(path, end), outputs_of(way, coarse))
    found = measure(scene, path, end, plan=plan, wall_s={"solve": wall_s}, corrected=corrected)
    return ScenePress(
        preset=scene.preset.value,
        edges=1.0 / scene.refinement,
        promised=promised,
        tet_count=len(model.elements),
        unknown_count=model.pattern.dof_count,
        setup_s=setup_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        iterations=way.counts.newton_iterations + own_way * path.counts.newton_iterations,
        force_n=found.force_n,
        moment_nm=found.moment_nm,
        depth_m=found.depth_m,
        stiffness_n_m=stiffness,
        balance=found.force_balance_relative,
        corrected=corrected,
    )


def moves(
    scene: Scene, *, count: int = FRAME_COUNT, part: float = 1.0
) -> list[Callable[[LoadingPath], PathPoint]]:
    """Return what to do on a path, frame by frame: down, then, where there is one, the motion.

    Args:
        count: Of frames; where there is a motion it takes half of them.
        part: Of the whole way.
    """
    motion, target = scene.motion, scene.target
    pressing = pressing_frames(scene, count)
    time_s = scene.duration_s / count

    def down(share: float) -> Callable[[LoadingPath], PathPoint]:
        if target.depth_m is not None:
            depth = share * target.depth_m
            return lambda path: path.advance(depth, duration_s=time_s)
        force = share * (target.force_n or 0.0)
        return lambda path: path.push(force, duration_s=time_s)

    frames = [down(part * k / pressing) for k in range(1, pressing + 1)]
    if pressing < count:
        left = count - pressing
        x, y = (part * along / left for along in motion.shift_m)
        hold = Hold.DEPTH if target.depth_m is not None else Hold.FORCE
        frames += [
            lambda path: path.carry(
                shift_m=(x, y),
                twist_rad=part * motion.twist_rad / left,
                hold=hold,
                duration_s=time_s,
            )
        ] * left
    return frames
