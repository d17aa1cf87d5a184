"""One scene pressed in frames and timed: alone, or in many environments of a batch."""

import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from sim.batch.batch import Batch, BatchForces
from sim.batch.motion_steps import BatchOptions
from sim.batch.sensor_model import sensor_model
from sim.cheapest_setting import keeping, keeping_corrected
from sim.effects.effect_choice import PRESET_TOLERANCE, plan_effects
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import ON_WAY, ended, goes_on, has_own_way, path_for, way_of
from sim.fields.stress import StressProjection
from sim.mesh_bias_correction import correction
from sim.optics.surface_images import SurfaceImages
from sim.press import measure
from sim.press_arguments import scene_from
from sim.scene.indenter import tilted
from sim.scene.material import Material
from sim.scene.objects import OBJECTS
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import Hold, LoadingPath, touch_height
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.bench.scenes import FRAME_COUNT, Manner, ScenePress
from sim.tolerance import parse_tolerance
from tacauchy_rig.core.arrays import FloatArray
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
    scene, promised = within(stated_scene(stated), manner.tolerance, corrected=alone)
    if not alone:
        return asdict(press_batch(scene, manner))
    return asdict(press_in_frames(scene, promised=promised, device=manner.device))


def press_reference(stated: Mapping[str, Any]) -> dict[str, Any]:
    """Press a line of the table once with the finest preset, for what others are compared with."""
    scene = replace(stated_scene(stated), preset=Preset.REFERENCE)
    return asdict(press_in_frames(scene, is_timed=False))


def stated_scene(stated: Mapping[str, Any]) -> Scene:
    """Return the scene of a line of the table."""
    given = {"sensor": "gelsight-mini", "indenter": "plane", **stated}
    triangles = given.pop("object", None)
    scene = scene_from(" ".join(f"--{name} {shlex.quote(str(v))}" for name, v in given.items()))
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
            on_way = points[round(ON_WAY * len(points)) - 1] if goes_on(scene, plan) else coarse
            end = ended(scene, way, on_way, coarse, path)
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
    return count // 2 if scene.motion.moves else count


def moves(
    scene: Scene, *, count: int = FRAME_COUNT, part: float = 1.0
) -> list[Callable[[LoadingPath], PathPoint]]:
    """Return what to do on a path, frame by frame: down, then, where there is one, the motion.

    Args:
        part: Of the whole way.
    """
    target, time_s = scene.target, scene.duration_s / count
    hold = Hold.FORCE if target.depth_m is None else Hold.DEPTH
    goals = part * goals_of(scene, count)
    steps = np.diff(goals, axis=0, prepend=0.0 * goals[:1])

    def move(number: int, path: LoadingPath) -> PathPoint:
        if number >= pressing_frames(scene, count):
            _, x, y, twist = steps[number].tolist()
            return path.carry(shift_m=(x, y), twist_rad=twist, hold=hold, duration_s=time_s)
        share = float(goals[number, 0])
        if target.depth_m is not None:
            return path.advance(share * target.depth_m, duration_s=time_s)
        return path.push(share * (target.force_n or 0.0), duration_s=time_s)

    return [partial(move, number) for number in range(count)]


# --- In a batch.
_REPEATS = 50
# Edge length of the sensor's mesh [m], and the residual over the contact force.
_EDGE_M, _BALANCE = 1.7e-3, 1e-3
# The environments after the first differ by up to so much in modulus, and are pressed so much less
# deep or hard.
_SPREAD = 0.1
# Of the pad's height: where the search for a load's depth begins.
_SEARCH_SHARE = 0.02


def press_batch(scene: Scene, manner: Manner) -> ScenePress:
    """Press a scene on its sensor's mesh, in environments a little unlike it, from rest on.

    The first is the scene itself. Set-up compiles the kernels.
    """
    started = time.perf_counter()
    assert isinstance(scene.pad, BoxPad)  # noqa: S101 - every sensor's is
    terms: dict[str, Any] = {"layers": scene.layers, "friction": scene.friction}
    mesh: dict[str, Any] = {"edge_m": _EDGE_M, "device": manner.device}
    model, count = (
        sensor_model(scene.pad, scene.material, **mesh, **terms),
        manner.environments or 1,
    )
    gels, shares = spread(scene, count)
    options = BatchOptions(residual_relative=_BALANCE)
    batch = Batch(model, [scene.indenter], np.zeros(count, int), materials=gels, options=options)
    trajectory = trajectory_of(scene, model, shares=shares)
    whole = partial(pressed, batch, *trajectory, seen_by=scene.sensor if manner.images else "")
    whole()
    setup_s = time.perf_counter() - started
    times = []
    for _ in range(_PRESSES):
        wall, cpu = time.perf_counter(), time.process_time()
        found = whole()
        times.append((time.perf_counter() - wall, time.process_time() - cpu))
    wall_s, cpu_s = min(times)
    failed = ~found[-1].valid
    if failed.any():
        raise ConvergenceError(f"{failed.sum()} of {count} did not reach the last frame")
    x, y, z = found[-1].wrench[0, :3].tolist()
    ends = np.array([(each.tips_m[0, 2], each.wrench[0, 2]) for each in found])
    down_m, more_n = ends[pressing_frames(scene) - 2] - ends[pressing_frames(scene) - 1]
    return ScenePress(
        preset="sensor's mesh",
        edges=1.0,
        promised=False,
        tet_count=len(model.elements),
        unknown_count=model.pattern.dof_count,
        setup_s=setup_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        iterations=round(float(sum(each.evaluations.mean() for each in found))),
        force_n=(x, y, z),
        moment_nm=None,
        depth_m=float(_touch_m(scene, model) - ends[-1, 0]),
        stiffness_n_m=float(-more_n / down_m),
        balance=float(np.abs(found[-1].imbalance).max()),
        parts_s={"stress": stress_s(batch)},
    )


def _touch_m(scene: Scene, model: Model) -> float:
    """Return the height of the tip that touches the pad at rest [m], the scene's tilt included."""
    pose: dict[str, Any] = {"centre_m": scene.centre_m, "rotation": tilted(*scene.motion.tilt_rad)}
    touch_m = touch_height(model, scene.indenter, model.nodes, **pose)
    return touch_m - model.contact_options.distance_m


def trajectory_of(
    scene: Scene, model: Model, *, shares: FloatArray, frame_count: int = FRAME_COUNT
) -> tuple[FloatArray, FloatArray | None]:
    """Return a scene's poses in equal frames, and its loads [N]: down, then its motion.

    Args:
        shares: Of the depth or the load, by environment.

    Returns:
        Poses as ``Batch.follow`` takes them, and loads where the scene's force is given, shape
        [frame_count, environment_count].
    """
    goals, target = goals_of(scene, frame_count), scene.target
    down, shift_m, turn_rad = goals[:, :1] * shares, goals[:, 1:3], goals[:, 3]
    poses = np.zeros((*down.shape, 7))
    poses[..., :2] = (scene.centre_m + shift_m)[:, None]
    depth = _SEARCH_SHARE * model.height_m if target.depth_m is None else down * target.depth_m
    poses[..., 2] = _touch_m(scene, model) - depth
    turns = Rotation.from_rotvec(turn_rad[:, None] * [0.0, 0.0, 1.0])
    turns *= Rotation.from_matrix(tilted(*scene.motion.tilt_rad))
    poses[..., 3:] = turns.as_quat()[:, None]
    return poses, None if target.force_n is None else down * target.force_n


def goals_of(scene: Scene, frame_count: int = FRAME_COUNT) -> FloatArray:
    """Return shares of the depth or load, shifts [m] and turns [rad] of frames, shape [..., 4]."""
    motion, pressing = scene.motion, pressing_frames(scene, frame_count)
    frames = np.arange(1, frame_count + 1)
    beside = np.maximum(0.0, frames - pressing) / max(1, frame_count - pressing)
    down = np.minimum(1.0, frames / pressing)
    return np.column_stack([down, np.outer(beside, [*motion.shift_m, motion.twist_rad])])


def spread(scene: Scene, count: int) -> tuple[list[tuple[Material, ...]], FloatArray]:
    """Return gels of a scene and of others a little unlike it, and shares of its depth or load.

    Gels are up to a tenth stiffer, and pressed up to a tenth less deep or hard; always the same.
    """
    stiffer, weaker = _SPREAD * np.random.default_rng(0).random((2, count))
    stiffer[0] = weaker[0] = 0.0
    gels = [
        tuple(replace(each, young_pa=each.young_pa * (1.0 + more)) for each in scene.materials)
        for more in stiffer.tolist()
    ]
    return gels, 1.0 - weaker


def pressed(
    batch: Batch, poses: FloatArray, loads_n: FloatArray | None, *, seen_by: str = ""
) -> list[BatchForces]:
    """Press a batch from the untouched gel, and return what each frame found.

    Args:
        seen_by: Sensor whose camera has an image and markers of every frame; the surface's stress
            is then found in each as well, and environments wait for each other. Empty for the
            forces alone.
    """
    batch.reset()
    if not seen_by:
        found = batch.follow(poses, loads_n=loads_n)
        return [found[frame] for frame in range(len(poses))]
    camera = SurfaceImages(batch.model, batch.indenters[0], load_sensor(seen_by), count=batch.count)
    stress = StressProjection(batch.model, batch.positions, gel=batch.gel)
    frames = []
    for number, pose in enumerate(poses):
        frames.append(batch.step(pose, loads_n=None if loads_n is None else loads_n[number]))
        stress.launch()
        camera.markers(batch.positions)
        camera.images(batch.positions, batch.poses.tips, batch.poses.rotations)
    return frames


def stress_s(batch: Batch) -> float:
    """Return what the surface's stress of all environments takes in one launch [s]."""
    stress = StressProjection(batch.model, batch.positions, gel=batch.gel)
    return _time_of(stress.launch, device=batch.model.device)


def _time_of(launch: Callable[[], None], *, device: str) -> float:
    """Return the mean time of a launch [s]; on a GPU from one graph of them all."""

    def launches() -> None:
        for _ in range(_REPEATS):
            launch()

    launch()
    if device != "cpu":
        with wp.ScopedCapture(device=device) as capture:
            launches()
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)
    started = time.perf_counter()
    if device == "cpu":
        launches()
    else:
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)
    return (time.perf_counter() - started) / _REPEATS
