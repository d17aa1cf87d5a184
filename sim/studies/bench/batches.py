"""A scene in many environments of a batch, and what each launch of it takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import warp as wp

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, BatchResult, Environment, Trajectory
from sim.batch.pilot import Pilot, batch_model
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import tilted
from sim.scene.material import Material
from sim.scene.scene import Scene
from sim.sensor.sensor import load_sensor
from sim.solve.model import Model
from sim.studies.bench.scenes import FRAME_COUNT, Manner, ScenePress
from tacauchy_rig.core.errors import ConvergenceError

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
_PRESSES = 3
# The environments after the first differ by up to so much in modulus and Poisson's ratio, and are
# pressed so much less deep.
_SPREAD, _POISSON_SPREAD = 0.1, 0.01
# Of the load, at which a pilot slides once more: over their moduli, loads are 0.82 to 1 of its own.
_LESS = 0.93


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
    times = [(_part_of(each.name), 1e-3 * each.elapsed) for each in wp.timing_end()]
    steps = sum(name == "prepare" for name, _ in times)
    for part in dict.fromkeys((*_PARTS.values(), _REST)):
        if taken := sum(spent for name, spent in times if name == part):
            parts[part] = taken / steps
    return parts | {"whole step": wall_s / steps}


def _part_of(kernel: str) -> str:
    return next((part for word, part in _PARTS.items() if word in kernel), _REST)


def _time_of(launch: Callable[[], None], *, device: str, repeats: int = _REPEATS) -> float:
    """Return the mean time of a launch [s]; on a GPU from one graph of them all."""
    launch()
    if device == "cpu":
        started = time.perf_counter()
        for _ in range(repeats):
            launch()
        return (time.perf_counter() - started) / repeats
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(repeats):
            launch()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    started = time.perf_counter()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    return (time.perf_counter() - started) / repeats


def pressing_frames(scene: Scene, count: int = FRAME_COUNT) -> int:
    """Return how many of the frames go down; a motion takes half of them."""
    moving = any(scene.motion.shift_m) or scene.motion.twist_rad != 0.0
    return count // 2 if moving else count


def trajectory_of(scene: Scene, *, frame_count: int) -> Trajectory:
    """Return a scene's trajectory in equal frames: down, then, in half of them, its motion."""
    motion, target = scene.motion, scene.target
    pressing = pressing_frames(scene, frame_count)
    down = np.minimum(1.0, np.arange(1, frame_count + 1) / pressing)
    beside = np.maximum(0.0, np.arange(1, frame_count + 1) - pressing) / max(
        1, frame_count - pressing
    )
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

    Raises:
        ConfigError: There is no such sensor.
    """
    environments, trajectories = zip(*chosen, strict=True)
    options = BatchOptions(residual_relative=_BALANCE)
    batch = Batch(pilot, environments, options=options, device=device)
    if seen_by:
        _watch(batch, seen_by)
    batch.prepare(trajectories[0].frame_count)
    return batch, [batch.press(trajectories) for _ in range(_PRESSES)]


def _watch(batch: Batch, sensor: str) -> None:
    """Have stress, markers and an image made of every environment in every frame."""
    camera = SurfaceImages(
        batch.model, batch.pilot.indenter, load_sensor(sensor), count=batch.count
    )
    batch.watch(batch.stress.launch)
    batch.watch(lambda: camera.markers(batch.positions))
    batch.watch(lambda: camera.images(batch.positions, batch.poses.tips, batch.poses.rotations))


@cache
def _prepared(key: str, own_mesh: bool) -> list[Pilot]:
    """Return a place for the pilot that batches of a scene share."""
    del key, own_mesh
    return []


def press_batch(scene: Scene, key: str, manner: Manner) -> ScenePress:
    """Press a scene in environments a little unlike it; the first is the scene itself.

    Batches of one scene in one process share the pilot and its inverses, which the first has in
    its set-up.

    Args:
        key: Names the scene; equal ones share a pilot.

    Raises:
        ConfigError: A batch cannot do this scene.
        ConvergenceError: An environment does not reach its last frame.
    """
    started = time.perf_counter()
    if manner.own_mesh:
        scene = replace(scene, refinement=1.0)
    trajectory = trajectory_of(scene, frame_count=FRAME_COUNT)
    kept = _prepared(key, manner.own_mesh)
    if not kept:
        middle = amid(scene)
        plain = manner.own_mesh
        model = batch_model(middle) if plain else path_for(middle, plan_effects(middle)).model
        kept.append(pilot_for(scene, model, trajectory))
    spent = time.process_time()
    chosen = spread(scene, trajectory, manner.environments or 1)
    seen_by = scene.sensor if manner.images else ""
    batch, results = pressed(kept[0], chosen, seen_by=seen_by, device=manner.device)
    cpu_s = (time.process_time() - spent) / len(results)
    setup_s = time.perf_counter() - started - sum(result.wall_s for result in results)
    return _judged(scene, batch, chosen, results, setup_s=setup_s, cpu_s=cpu_s)


def _judged(
    scene: Scene,
    batch: Batch,
    chosen: Sequence[tuple[Environment, Trajectory]],
    results: Sequence[BatchResult],
    *,
    setup_s: float,
    cpu_s: float,
) -> ScenePress:
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
