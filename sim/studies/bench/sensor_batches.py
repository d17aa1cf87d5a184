"""Presses of unlike indenters at unlike poses in one batch: their time, and their forces."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from sim.batch.sensor_batch import SensorBatch, sensor_model
from sim.device import Device
from sim.error import Tolerance, keeping_corrected
from sim.press import press
from sim.scene.indenter import (
    Cylinder,
    Indenter,
    Sphere,
    cylinder_triangles,
    mesh_indenter,
    tilted,
)
from sim.scene.pad import BoxPad
from sim.scene.scene import Motion, Scene, Target
from sim.studies.bench.parts import Row
from sim.studies.bench.rendering import batch_device
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

UNLIKE_SEED, ALONE_SEED = 31337, 90210
_ON_GPU, _ON_CPU = 1000, 8
_EDGES_M = (2.5e-3, 1.7e-3, 1.25e-3)
OFF = "F_z off the finest mesh, median [%]"
# Of the pad's height: the least and the greatest depth; and the greatest tilt.
_DEPTHS, _TILT_RAD = (0.02, 0.4), np.radians(15.0)
# A ball is pressed in by less than its half; an indenter stands so far from the pad's edge [m].
_BALL_SHARE, _MARGIN_M = 0.45, 3e-3
_COUNT, TOLERANCE = 40, 0.01
WITHIN, HOLDS = "within 5 % [%]", "within what is stated [%]"
WITHIN_WANTED, _NEAR = 90.0, 0.05
_prose = partial(table_prose, "sim.studies.bench", "tables.md.jinja")


def _box(scene: Scene) -> BoxPad:
    assert isinstance(scene.pad, BoxPad)  # noqa: S101 - every sensor's is
    return scene.pad


def unlike_bodies() -> list[Indenter]:
    """Return six balls, four rounded punches, and five sharp prisms of triangles."""
    balls = [Sphere(diameter_m=1e-3 * d) for d in (2, 4, 6, 8, 10, 15)]
    sizes = ((3, 0.3), (5, 0.3), (5, 0.5), (6, 0.2))
    punches = [Cylinder(diameter_m=1e-3 * d, fillet_m=1e-3 * fillet) for d, fillet in sizes]
    prisms = []
    for sides, d in ((3, 6), (4, 5), (5, 4), (6, 6), (8, 4.4)):
        triangles = cylinder_triangles(Cylinder(diameter_m=1e-3 * d), sectors=sides)
        prisms.append(mesh_indenter(*triangles, name=f"prism of {sides} sides"))
    return [*balls, *punches, *prisms]


def rounded_bodies(count: int, *, seed: int) -> list[Indenter]:
    """Draw balls of 2 to 15 mm and punches of 3 to 8 mm with fillets of 0.2 to 0.8 mm, in turn."""
    rng = np.random.default_rng(seed)
    drawn: list[Indenter] = []
    for k in range(count):
        if k % 2 == 0:
            drawn.append(Sphere(diameter_m=float(rng.uniform(2e-3, 15e-3))))
            continue
        diameter_m, fillet_m = float(rng.uniform(3e-3, 8e-3)), float(rng.uniform(0.2e-3, 0.8e-3))
        drawn.append(Cylinder(diameter_m=diameter_m, fillet_m=fillet_m))
    return drawn


def draw_poses(
    pad: BoxPad, of: Sequence[Indenter], count: int, *, seed: int, which: IntArray | None = None
) -> tuple[IntArray, FloatArray]:
    """Draw indenters by their place, if none are given, and poses anywhere, shape [count, 7]."""
    rng = np.random.default_rng(seed)
    if which is None:
        which = rng.integers(0, len(of), count).astype(np.int32)
    half = np.array(pad.half_extents()) - _MARGIN_M
    poses = np.zeros((count, 7))
    poses[:, :2] = rng.uniform(-half, half, (count, 2))
    depth = pad.height_m * rng.uniform(*_DEPTHS, count)
    for k, body in enumerate(of):
        if isinstance(body, Sphere):
            limit = _BALL_SHARE * body.diameter_m
            depth[which == k] = np.minimum(depth[which == k], limit)
    poses[:, 2] = pad.height_at(poses[:, 0], poses[:, 1]) - depth
    tilt, towards = _TILT_RAD * rng.uniform(size=count), 2.0 * np.pi * rng.uniform(size=count)
    axis = np.column_stack([np.cos(towards), np.sin(towards), np.zeros(count)])
    poses[:, 3:] = Rotation.from_rotvec(tilt[:, None] * axis).as_quat()
    return which, poses


def measure_unlike(scene: Scene, *, count: int = 0, edges_m: Sequence[float] = ()) -> Iterator[Row]:
    """Press drawn indenters on a scene's pad, all at once, without friction and with it.

    Args:
        count: Presses; 0 is 1000 on a GPU and 8 on a processor.
        edges_m: Of the sensor's mesh [m]; none are those that suit the device.
    """
    device = batch_device()
    on_gpu = device != "cpu"
    many = count or (_ON_GPU if on_gpu else _ON_CPU)
    for friction in (0.0, 0.5) if on_gpu else (0.0,):
        finest: FloatArray | None = None
        for edge_m in sorted(edges_m or (_EDGES_M if on_gpu else _EDGES_M[:1])):
            row, force_n = _pressed(scene, device, many, edge_m, friction)
            finest = force_n if finest is None else finest
            yield {**row, OFF: 1e2 * float(np.nanmedian(force_n / finest - 1.0))}


def _pressed(
    scene: Scene, device: str, count: int, edge_m: float, friction: float
) -> tuple[Row, FloatArray]:
    """Return a row, and F_z of every press [N]."""
    of, pad = unlike_bodies(), _box(scene)
    which, poses = draw_poses(pad, of, count, seed=UNLIKE_SEED)
    started = time.perf_counter()
    model = sensor_model(pad, scene.material, edge_m=edge_m, friction=friction, device=device)
    batch = SensorBatch(model, of, which)
    Device(device).synchronise()
    set_up = time.perf_counter() - started
    batch.step(poses)  # compiles its kernels
    batch.reset()
    started = time.perf_counter()
    felt = batch.step(poses)
    took = time.perf_counter() - started
    row = {
        "device": device,
        "edge [mm]": 1e3 * edge_m,
        "unknowns": model.pattern.dof_count,
        "friction": friction,
        "presses": count,
        "set-up [s]": set_up,
        "presses [s]": took,
        "a press [ms]": 1e3 * took / count,
        "found": int(felt.valid.sum()),
        "evaluations, median": float(np.median(felt.evaluations)),
        "evaluations, most": int(felt.evaluations.max()),
    }
    return row, felt.wrench[:, 2]


def unlike_table(rows: Sequence[Row]) -> Table:
    """Return what unlike presses take; all have to be found."""
    passed = all(row["found"] == row["presses"] for row in rows)
    return table_of_rows(rows, passed=passed, **_prose("unlike", seed=UNLIKE_SEED))


def measure_alone(
    scene: Scene,
    *,
    count: int = _COUNT,
    edges_m: Sequence[float] = _EDGES_M,
    tolerance: float = TOLERANCE,
) -> Iterator[Row]:
    """Press each alone, to a tolerance of F_z, then all in batches at the same heights."""
    pad, bodies = _box(scene), rounded_bodies(count, seed=ALONE_SEED)
    which = np.arange(count, dtype=np.int32)
    _, poses = draw_poses(pad, bodies, count, seed=ALONE_SEED, which=which)
    found = [_alone(scene, body, pose, tolerance) for body, pose in zip(bodies, poses, strict=True)]
    forces, poses = np.array([force for force, _ in found]), np.array([at for _, at in found])
    for edge_m in edges_m:
        model = sensor_model(pad, scene.material, edge_m=edge_m)
        felt = SensorBatch(model, bodies, range(count)).step(poses)
        off = felt.wrench[:, 2] / forces - 1.0
        yield {
            "edge [mm]": 1e3 * edge_m,
            "presses": count,
            "found": int(felt.valid.sum()),
            "F_z off, median [%]": 1e2 * float(np.nanmedian(off)),
            "lowest [%]": 1e2 * float(np.nanmin(off)),
            "highest [%]": 1e2 * float(np.nanmax(off)),
            WITHIN: 1e2 * float((np.abs(off) < _NEAR).mean()),
            HOLDS: 1e2 * float((np.abs(off) < felt.force_error).mean()),
        }


def _alone(
    scene: Scene, body: Indenter, pose: FloatArray, tolerance: float
) -> tuple[float, FloatArray]:
    """Return F_z of a press on its own mesh [N], and the pose it ends at."""
    axis = Rotation.from_quat(pose[3:]).as_matrix()[:, 2]
    tilt = (-float(np.arcsin(axis[1])), float(np.arctan2(axis[0], axis[2])))
    depth_m = float(scene.pad.height_at(pose[:1], pose[1:2])[0] - pose[2])
    own = replace(
        scene,
        indenter=body,
        target=Target(depth_m=depth_m),
        centre_m=(float(pose[0]), float(pose[1])),
        motion=Motion(tilt_rad=tilt),
    )
    result = press(keeping_corrected(own, Tolerance(relative=tolerance)))
    force = result.force_n[2] if result.corrected is None else result.corrected.force_n
    at = result.point.state.tip - [0.0, 0.0, result.model.contact_options.distance_m]
    return force, np.concatenate([at, Rotation.from_matrix(tilted(*tilt)).as_quat()])


def alone_table(rows: Sequence[Row]) -> Table:
    """Return how far the forces are off; the finest mesh's are to be close."""
    finest = min(rows, key=lambda row: row["edge [mm]"])
    passed = finest["found"] == finest["presses"] and finest[WITHIN] >= WITHIN_WANTED
    prose = _prose("alone", seed=ALONE_SEED, wanted=WITHIN_WANTED, tolerance=TOLERANCE)
    return table_of_rows(rows, passed=passed, **prose)
