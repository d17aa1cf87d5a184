"""One scene pressed in frames and timed: alone, or in many environments of a batch."""

from __future__ import annotations

import json
import math
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import warp as wp

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, BatchResult, Environment, Trajectory
from sim.batch.pilot import Pilot, batch_model
from sim.correction import correction
from sim.effects.end_state import carried_over, has_own_way, way_of
from sim.effects.outputs import outputs_of
from sim.effects.plan import PRESET_TOLERANCE, plan_effects
from sim.effects.scene_path import path_for
from sim.error import keeping, keeping_corrected, parse_tolerance
from sim.optics.surface_images import SurfaceImages
from sim.press import measure
from sim.press_command import scene_from
from sim.scene.indenter import tilted
from sim.scene.material import Material
from sim.scene.scene import Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.bench.scenes import FRAME_COUNT, Manner, ScenePress
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.core.errors import ConfigError, ConvergenceError

# The least of so many presses counts, if they do not take longer than this together [s].
_PRESSES, _ENOUGH_S = 3, 6.0
# Of the way, for what compiles or loads the kernels.
_WARM_SHARE = 0.1
# The preset where no setting states a tolerance: the first whose usual error is within it.
_UNPROMISED = ((0.03, Preset.FAST), (0.01, Preset.BALANCED), (0.0, Preset.ACCURATE))


def press_scene(stated: Mapping[str, Any], manner: Manner) -> dict[str, Any]:
    """Press a line of the table; return the fields of ``ScenePress``."""
    alone = manner.environments is None
    scene, is_stated = within(stated_scene(stated), manner.tolerance, corrected=alone)
    if alone:
        return asdict(press_in_frames(scene, promised=is_stated, device=manner.device))
    return asdict(press_batch(scene, json.dumps(dict(stated)), manner))


def press_reference(stated: Mapping[str, Any], preset: Preset) -> dict[str, Any]:
    """Press a line of the table once with a preset, for what others are compared with."""
    return asdict(press_in_frames(replace(stated_scene(stated), preset=preset), is_timed=False))


def stated_scene(stated: Mapping[str, Any]) -> Scene:
    """Return the scene of a line of the table."""
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
        is_timed: Compile the kernels before, and press several times.
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
    while len(times) < (_PRESSES if is_timed else 1) and sum(cpu for cpu, _ in times) < _ENOUGH_S:
        way = path_for(gone, plan, model=way_model)
        path = path_for(scene, plan, model=model) if own_way else way
        wall, cpu = time.perf_counter(), time.process_time()
        points = [move(way) for move in moves(scene)]
        stiffness = points[pressing_frames(scene) - 1].stiffness_n_m
        end = coarse = replace(points[-1], stiffness_n_m=stiffness)
        if own_way:
            end = carried_over(scene, way, coarse, path)
        times.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu_s, wall_s = min(times)
    corrected = None
    if own_way:
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


def pressing_frames(scene: Scene, count: int = FRAME_COUNT) -> int:
    """Return how many of the frames go down; a motion takes half of them."""
    moving = any(scene.motion.shift_m) or scene.motion.twist_rad != 0.0
    return count // 2 if moving else count


def moves(
    scene: Scene, *, count: int = FRAME_COUNT, part: float = 1.0
) -> list[Callable[[LoadingPath], PathPoint]]:
    """Return what to do on a path, frame by frame: down, then, where there is one, the motion.

    Args:
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


# --- In a batch.
_REPEATS = 50
# What a kernel with a word in its name does in a step; others begin and end the frames.
_PARTS = {
    "element": "gel",
    "touch": "contact",
    "judge": "judge",
    "prepare": "prepare",
    "product": "inverse",
    "turn": "turn",
    "hold": "hold",
}
_REST = "rest"
_BALANCE = 1e-5
# The environments after the first differ by up to so much in modulus and Poisson's ratio, and are
# pressed so much less deep.
_SPREAD, _POISSON_SPREAD = 0.1, 0.01
# Of the load, at which a pilot slides once more: over their moduli, loads are 0.82 to 1 of its own.
_LESS = 0.93
# By scene and mesh: batches of one scene in one process share the pilot and its inverses, which
# the first has in its set-up.
_PILOTS: dict[tuple[str, bool], Pilot] = {}


def press_batch(scene: Scene, key: str, manner: Manner) -> ScenePress:
    """Press a scene in environments a little unlike it; the first is the scene itself.

    Args:
        key: Names the scene; equal ones share a pilot.
    """
    started = time.perf_counter()
    if manner.own_mesh:
        scene = replace(scene, refinement=1.0)
    trajectory = trajectory_of(scene, frame_count=FRAME_COUNT)
    named = (key, manner.own_mesh)
    if named not in _PILOTS:
        middle = amid(scene)
        own = manner.own_mesh
        model = batch_model(middle) if own else path_for(middle, plan_effects(middle)).model
        _PILOTS[named] = pilot_for(scene, model, trajectory)
    spent = time.process_time()
    chosen = spread(scene, trajectory, manner.environments or 1)
    seen_by = scene.sensor if manner.images else ""
    batch, results = pressed(_PILOTS[named], chosen, seen_by=seen_by, device=manner.device)
    cpu_s = (time.process_time() - spent) / len(results)
    setup_s = time.perf_counter() - started - sum(result.wall_s for result in results)
    found = min(results, key=lambda result: result.wall_s)
    if found.failed.any():
        raise ConvergenceError(
            f"{found.failed.sum()} of {batch.count} did not reach the last frame"
        )
    x, y, z = found.force_n[-1, 0]
    depths, forces = found.depth_m[:, 0], found.force_n[:, 0, 2]
    last = pressing_frames(scene) - 1
    return ScenePress(
        preset=scene.preset.value,
        edges=1.0 / scene.refinement,
        promised=False,
        tet_count=len(batch.model.elements),
        unknown_count=batch.model.pattern.dof_count,
        setup_s=setup_s,
        wall_s=found.wall_s,
        cpu_s=cpu_s,
        iterations=round(float(found.evaluations.mean())),
        force_n=(float(x), float(y), float(z)),
        moment_nm=None,
        depth_m=float(depths[-1]),
        stiffness_n_m=float((forces[last] - forces[last - 1]) / (depths[last] - depths[last - 1])),
        balance=float(np.abs(found.imbalance[-1]).max()),
        parts_s=batch_parts(batch, chosen, wall_s=found.wall_s),
    )


def trajectory_of(scene: Scene, *, frame_count: int) -> Trajectory:
    """Return a scene's trajectory in equal frames: down, then, in half of them, its motion."""
    motion, target = scene.motion, scene.target
    pressing = pressing_frames(scene, frame_count)
    frames = np.arange(1, frame_count + 1)
    down = np.minimum(1.0, frames / pressing)
    beside = np.maximum(0.0, frames - pressing) / max(1, frame_count - pressing)
    return Trajectory(
        depths_m=None if target.depth_m is None else down * target.depth_m,
        loads_n=None if target.force_n is None else down * target.force_n,
        shifts_m=np.outer(beside, motion.shift_m),
        turns_rad=beside * motion.twist_rad,
    )


def scaled(trajectory: Trajectory, share: float) -> Trajectory:
    """Return a trajectory to a share of its depths or loads."""
    if trajectory.depths_m is not None:
        return replace(trajectory, depths_m=share * trajectory.depths_m)
    return replace(trajectory, loads_n=share * trajectory.along)


def spread(
    scene: Scene, trajectory: Trajectory, count: int
) -> list[tuple[Environment, Trajectory]]:
    """Return the scene itself and others a little unlike it, always the same ones.

    Gels are up to a tenth stiffer, with Poisson's ratios up to 0.01 smaller, and pressed up to a
    tenth less deep or hard.
    """
    random = np.random.default_rng(0)
    found = []
    for number in range(count):
        stiffer, thinner, weaker = random.random(3) if number else np.zeros(3)
        own = tuple(
            replace(
                material,
                young_pa=material.young_pa * (1.0 + _SPREAD * stiffer),
                poisson=material.poisson - _POISSON_SPREAD * thinner,
            )
            for material in scene.materials
        )
        found.append((Environment(materials=own), scaled(trajectory, 1.0 - _SPREAD * weaker)))
    return found


def amid(scene: Scene) -> Scene:
    """Return a scene with a gel for the pilot of those that ``spread`` gives.

    Its Poisson's ratio is in their middle, by what it makes of the bulk modulus; it is as soft as
    the softest of them, so that its indenter touches as much as any.
    """

    def amidst(material: Material) -> Material:
        left = 1.0 - 2.0 * material.poisson
        middle = math.sqrt(left * (left + 2.0 * _POISSON_SPREAD))
        return replace(material, poisson=0.5 * (1.0 - middle))

    layers = tuple(replace(each, material=amidst(each.material)) for each in scene.layers)
    return replace(scene, material=amidst(scene.material), layers=layers)


def pilot_for(scene: Scene, model: Model, trajectory: Trajectory) -> Pilot:
    """Return a pilot that keeps every frame, and goes as far as any that ``spread`` gives.

    One that is pushed slides once more at less load.
    """
    return Pilot(
        model,
        scene.indenter,
        trajectory,
        scene.centre_m,
        rotation=tilted(*scene.motion.tilt_rad),
        count=trajectory.frame_count,
        shares=(_LESS,) if trajectory.is_pushed else (),
    )


def pressed(
    pilot: Pilot,
    chosen: Sequence[tuple[Environment, Trajectory]],
    *,
    seen_by: str = "",
    device: str,
) -> tuple[Batch, list[BatchResult]]:
    """Press a batch several times, kernels and graphs made before.

    Args:
        seen_by: Sensor whose camera has an image and markers of every frame; the surface's stress
            is then found in each as well. Empty for the forces alone.
    """
    environments, trajectories = zip(*chosen, strict=True)
    options = BatchOptions(residual_relative=_BALANCE)
    batch = Batch(pilot, environments, options=options, device=device)
    if seen_by:
        camera = SurfaceImages(batch.model, pilot.indenter, load_sensor(seen_by), count=batch.count)
        batch.watch(batch.stress.launch)
        batch.watch(lambda: camera.markers(batch.positions))
        batch.watch(lambda: camera.images(batch.positions, batch.poses.tips, batch.poses.rotations))
    batch.prepare(trajectories[0].frame_count)
    return batch, [batch.press(trajectories) for _ in range(_PRESSES)]


def batch_parts(
    batch: Batch, chosen: Sequence[tuple[Environment, Trajectory]], *, wall_s: float
) -> dict[str, float]:
    """Time what a step of a press takes, and the stress of all environments once [s].

    On a GPU the environments are pressed once more, launch by launch, each timed by the device;
    kernels that wait for the host between are not beside each other as in a recorded step. On a
    processor nothing but the stress is timed.

    Args:
        wall_s: Of the press as it is, for what a whole step takes.
    """
    parts = {"stress": _time_of(batch.stress.launch, device=batch.device)}
    if batch.device == "cpu":
        return parts
    trajectories = [trajectory for _, trajectory in chosen]
    batch.prepare(trajectories[0].frame_count).launch_singly()
    wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
    batch.press(trajectories)
    times = [
        (next((part for word, part in _PARTS.items() if word in each.name), _REST), each.elapsed)
        for each in wp.timing_end()
    ]
    steps = sum(name == "prepare" for name, _ in times)
    for part in dict.fromkeys((*_PARTS.values(), _REST)):
        if taken := sum(1e-3 * spent for name, spent in times if name == part):
            parts[part] = taken / steps
    return parts | {"whole step": wall_s / steps}


def _time_of(launch: Callable[[], None], *, device: str) -> float:
    """Return the mean time of a launch [s]; on a GPU from one graph of them all."""

    def launches() -> None:
        for _ in range(_REPEATS):
            launch()

    def graph() -> None:
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)

    launch()
    run = launches
    if device != "cpu":
        with wp.ScopedCapture(device=device) as capture:
            launches()
        run = graph
        run()
    started = time.perf_counter()
    run()
    return (time.perf_counter() - started) / _REPEATS
