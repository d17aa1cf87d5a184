"""A scene in many environments of a batch."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sim.batch.batch import Batch
from sim.batch.environment import BatchResult, Course, Environment
from sim.batch.pilot import batch_model
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.scene.scene import Scene
from sim.studies.bench.batches import (
    amid,
    batch_parts,
    course_of,
    pilot_for,
    pressed,
    spread,
)
from sim.studies.bench.scenes.press import FRAME_COUNT, ScenePress, pressing_frames
from tacauchy_rig.core.errors import ConvergenceError


def press_side_by_side(
    scene: Scene,
    *,
    counts: Sequence[int],
    device: str,
    images: bool = False,
    own_mesh: bool = False,
) -> Iterator[ScenePress]:
    """Press a scene in environments a little unlike it; the first is the scene itself.

    Args:
        counts: Of environments, one batch after the other; they share the pilot and its inverses,
            which the first has in its set-up.
        own_mesh: Press on the mesh that a batch makes itself, coarser than a press's.
        images: Have the sensor's image, its markers and the surface's stress in every frame.

    Raises:
        ConfigError: A batch cannot do this scene.
        ConvergenceError: An environment does not reach its last frame.
    """
    started = time.perf_counter()
    if own_mesh:
        scene = replace(scene, refinement=1.0)
    middle = amid(scene)
    model = batch_model(middle) if own_mesh else path_for(middle, plan_effects(middle)).model
    course = course_of(scene, frame_count=FRAME_COUNT)
    pilot = pilot_for(scene, model, course)
    for count in counts:
        spent = time.process_time()
        chosen = spread(scene, course, count)
        batch, results = pressed(
            pilot,
            chosen,
            seen_by=scene.sensor if images else "",
            device=device,
        )
        cpu_s = (time.process_time() - spent) / len(results)
        pressed_s = sum(result.wall_s for result in results)
        setup_s = time.perf_counter() - started - pressed_s
        yield _judged(scene, batch, chosen, results, setup_s=setup_s, cpu_s=cpu_s)
        started = time.perf_counter()


def _judged(
    scene: Scene,
    batch: Batch,
    chosen: Sequence[tuple[Environment, Course]],
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
