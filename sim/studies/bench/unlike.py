"""Presses of unlike indenters at unlike poses in one batch, as rows and a table."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from sim.batch.sensor_batch import SensorBatch, sensor_model
from sim.device import Device
from sim.scene.indenter import Cylinder, Indenter, Sphere, cylinder_triangles, mesh_indenter
from sim.scene.pad import BoxPad
from sim.scene.scene import Scene
from sim.studies.bench.parts import Row
from sim.studies.bench.rendering import batch_device
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

SEED = 31337
_ON_GPU, _ON_CPU = 1000, 8
_EDGES_ON_GPU, _EDGES_ON_CPU = (2.5e-3, 1.7e-3, 1.25e-3), (2.5e-3,)
OFF = "F_z off the finest mesh, median [%]"
# Of the pad's height: the least and the greatest depth; and the greatest tilt.
_DEPTHS, _TILT_RAD = (0.02, 0.4), np.radians(15.0)
# A ball is pressed in by less than its half; an indenter stands so far from the pad's edge [m].
_BALL_SHARE, _MARGIN_M = 0.45, 3e-3


def bodies() -> list[Indenter]:
    """Return six balls, four rounded punches, and five sharp prisms of triangles."""
    balls = [Sphere(diameter_m=1e-3 * d) for d in (2, 4, 6, 8, 10, 15)]
    sizes = ((3, 0.3), (5, 0.3), (5, 0.5), (6, 0.2))
    punches = [Cylinder(diameter_m=1e-3 * d, fillet_m=1e-3 * fillet) for d, fillet in sizes]
    prisms = []
    for sides, d in ((3, 6), (4, 5), (5, 4), (6, 6), (8, 4.4)):
        triangles = cylinder_triangles(Cylinder(diameter_m=1e-3 * d), sectors=sides)
        prisms.append(mesh_indenter(*triangles, name=f"prism of {sides} sides"))
    return [*balls, *punches, *prisms]


def draw_poses(
    pad: BoxPad,
    of: Sequence[Indenter],
    count: int,
    *,
    seed: int = SEED,
    which: IntArray | None = None,
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
        for edge_m in sorted(edges_m or (_EDGES_ON_GPU if on_gpu else _EDGES_ON_CPU)):
            row, force_n = _pressed(scene, device, many, edge_m, friction)
            finest = force_n if finest is None else finest
            yield {**row, OFF: 1e2 * float(np.nanmedian(force_n / finest - 1.0))}


def _pressed(
    scene: Scene, device: str, count: int, edge_m: float, friction: float
) -> tuple[Row, FloatArray]:
    """Return a row, and F_z of every press [N]."""
    of, pad = bodies(), scene.pad
    assert isinstance(pad, BoxPad)  # noqa: S101 - every sensor's is
    which, poses = draw_poses(pad, of, count)
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
    prose = table_prose("sim.studies.bench", "tables.md.jinja", "unlike", seed=SEED)
    return table_of_rows(rows, passed=passed, **prose)
