"""A scene in many environments of a batch, and what a batch cannot do of it yet."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions
from sim.batch.pilot import Pilot, batch_model
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import ContactMode, Scene
from sim.studies.bench.batches import BALANCE, environments
from sim.studies.bench.scenes.press import FRAME_COUNT, ScenePress
from tacauchy_rig.errors import ConfigError, ConvergenceError

# As for the batches' own part: two for every frame, the least of three presses.
_PILOTS, _PRESSES = 2 * FRAME_COUNT, 3


def press_side_by_side(scene: Scene, *, count: int, device: str) -> ScenePress:
    """Press a scene in environments that differ by up to a tenth; the first is the scene itself.

    Raises:
        ConfigError: A batch cannot do this scene.
        ConvergenceError: An environment does not reach its last frame.
    """
    lacking = ", ".join(_lacking(scene))
    depth = scene.target.depth_m
    if lacking or depth is None:
        raise ConfigError(f"not yet: {lacking}", remedy="press one by one")
    started = time.perf_counter()
    model = batch_model(scene, symmetric=scene.motion.is_straight)
    pilot = Pilot(model, scene.indenter, depth, scene.centre_m, count=_PILOTS)
    batch = Batch(
        pilot,
        environments(scene, count),
        options=BatchOptions(residual_relative=BALANCE),
        device=device,
    )
    batch.prepare()
    setup_s = time.perf_counter() - started
    presses = []
    for _ in range(_PRESSES):
        spent = time.process_time()
        found = batch.press()
        presses.append((found.wall_s, time.process_time() - spent, found))
    wall_s, cpu_s, found = min(presses, key=lambda press: press[0])
    if found.failed.any():
        raise ConvergenceError(f"{found.failed.sum()} of {count} did not reach the last frame")
    (x, y, z), depths = found.force_n[-1, 0], found.depth_m[-2:, 0]
    return ScenePress(
        preset="batch",
        edges=1.0,
        promised=False,
        tet_count=len(model.elements),
        unknown_count=model.pattern.dof_count,
        setup_s=setup_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        iterations=round(float(found.evaluations.mean())),
        force_n=(float(x), float(y), float(z)),
        moment_nm=None,
        depth_m=float(depths[-1]),
        stiffness_n_m=float(np.diff(found.force_n[-2:, 0, 2])[0] / np.diff(depths)[0]),
        balance=float(np.abs(found.imbalance[-1]).max()),
    )


def _lacking(scene: Scene) -> Iterator[str]:
    """Name what a batch lacks for a scene."""
    if scene.contact is not ContactMode.FRICTIONLESS:
        yield "friction" if scene.contact is ContactMode.FRICTION else "bonded contact"
    if scene.layers:
        yield "layers"
    if isinstance(scene.indenter, MeshIndenter):
        yield "triangles"
    if any(scene.motion.shift_m) or scene.motion.twist_rad:
        yield "motion along the surface"
    if scene.target.depth_m is None:
        yield "a load in this benchmark"
