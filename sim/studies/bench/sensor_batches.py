"""Unlike indenters at unlike poses and on unlike paths in one batch: their time, their forces."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from sim.batch.batch import Batch, BatchForces
from sim.batch.force_bias import press_alone
from sim.batch.motion_steps import BatchOptions
from sim.batch.sensor_model import sensor_model
from sim.device import Device
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import Cylinder, Indenter, Sphere, cylinder_triangles, mesh_indenter
from sim.scene.pad import BoxPad
from sim.scene.scene import Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.bench.rendering import Row, batch_device
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.markdown_page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

UNLIKE_SEED, ALONE_SEED = 20261205, 20261206
_ON_GPU, _ON_CPU = 1000, 8
_EDGES_M = (2.5e-3, 1.7e-3, 1.25e-3)
OFF = "F_z off the finest mesh, median [%]"
# Of the pad's height: the least and the greatest depth; and the greatest tilt.
_DEPTHS, _TILT_RAD = (0.02, 0.4), np.radians(15.0)
# A ball is pressed in by less than its half; an indenter stands so far from the pad's edge [m].
_BALL_SHARE, _MARGIN_M = 0.45, 3e-3
# How far a press may slide along each axis, and twist.
_SLIDE_M, _TWIST_RAD = 0.5e-3, np.radians(15.0)
# Moving tools: environments and frames on a GPU, and on a processor; frames a second; residuals.
_MOVING_ON_GPU, _MOVING_ON_CPU, _RATE_HZ = ((60, 1000), (1024, 200)), ((4, 30),), 60.0
_RESIDUALS = (1e-3, 1e-5)
# Of the poses' sines: amplitudes [m, rad], and the lowest and highest frequency [1/s]; the mean
# depth [m]. Tools leave the gel and touch it again, at up to 5 mm/s and 60 degrees/s.
_AMPLITUDES = (1e-3, 1e-3, 0.5e-3, 0.15, 0.15, 0.25)
_FREQUENCIES_HZ, _MEAN_DEPTH_M = (0.3, 0.6), 0.15e-3
_FEW_FRAMES, LOST, _FELT_N = 50, "frames not found", 1e-3
_COUNT, TOLERANCE = 100, 0.01
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
    return [
        Cylinder(diameter_m=rng.uniform(3e-3, 8e-3), fillet_m=rng.uniform(0.2e-3, 0.8e-3))
        if k % 2
        else Sphere(diameter_m=rng.uniform(2e-3, 15e-3))
        for k in range(count)
    ]


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
    limits = [_BALL_SHARE * b.diameter_m if isinstance(b, Sphere) else np.inf for b in of]
    depth = np.minimum(depth, np.array(limits)[which])
    poses[:, 2] = pad.height_at(poses[:, 0], poses[:, 1]) - depth
    tilt, towards = _TILT_RAD * rng.uniform(size=count), 2.0 * np.pi * rng.uniform(size=count)
    axis = np.column_stack([np.cos(towards), np.sin(towards), np.zeros(count)])
    poses[:, 3:] = Rotation.from_rotvec(tilt[:, None] * axis).as_quat()
    return which, poses


def slid(poses: FloatArray, *, seed: int) -> FloatArray:
    """Return poses of which every second one is slid and twisted, shape [count, 7]."""
    rng, later = np.random.default_rng(seed), poses.copy()
    half = later[::2]
    half[:, :2] += rng.uniform(-_SLIDE_M, _SLIDE_M, (len(half), 2))
    turn = Rotation.from_euler("z", rng.uniform(-_TWIST_RAD, _TWIST_RAD, (len(half), 1)))
    half[:, 3:] = (turn * Rotation.from_quat(half[:, 3:])).as_quat()
    return later


def measure_unlike(
    scene: Scene, *, count: int = 0, edges_m: Sequence[float] = (), seed: int = UNLIKE_SEED
) -> Iterator[Row]:
    """Press drawn indenters on a scene's pad, all at once, without friction and with it.

    With friction every press has a coefficient of its own, and half of them slide and twist.

    Args:
        count: Presses; 0 is 1000 on a GPU and 8 on a processor.
        edges_m: Of the sensor's mesh [m]; none are those that suit the device.
    """
    device = batch_device()
    on_gpu = device != "cpu"
    many = count or (_ON_GPU if on_gpu else _ON_CPU)
    for rubs in (False, True):
        finest: FloatArray | None = None
        for edge_m in sorted(edges_m or (_EDGES_M if on_gpu else _EDGES_M[:1])):
            row, felt = _pressed(scene, device, many, edge_m, rubs=rubs, seed=seed)
            force_n = felt.wrench[:, 2]
            finest = force_n if finest is None else finest
            touches = np.isfinite(force_n) & (np.abs(finest) > _FELT_N)
            off = force_n[touches] / finest[touches] - 1.0
            holds = np.abs(off) <= felt.force_error[touches]
            yield {**row, OFF: 1e2 * float(np.median(off)), HOLDS: 1e2 * float(holds.mean())}


def _pressed(
    scene: Scene, device: str, count: int, edge_m: float, *, rubs: bool, seed: int
) -> tuple[Row, BatchForces]:
    """Return a row, and the forces of every press."""
    of, pad = unlike_bodies(), _box(scene)
    which, poses = draw_poses(pad, of, count, seed=seed)
    path = np.stack([poses, slid(poses, seed=seed)] if rubs else [poses])
    friction = np.random.default_rng(seed).uniform(size=count) if rubs else None
    started = time.perf_counter()
    model = sensor_model(pad, scene.material, edge_m=edge_m, friction=float(rubs), device=device)
    batch = Batch(model, of, which, friction=friction)
    Device(device).synchronise()
    set_up = time.perf_counter() - started
    camera = SurfaceImages(model, batch.descents.indenter, load_sensor(scene.sensor), count=count)

    def outputs() -> None:
        batch.tractions()
        camera.images(batch.positions, batch.poses.tips, batch.poses.rotations)
        Device(device).synchronise()

    batch.follow(path)  # compiles its kernels
    outputs()
    batch.reset()
    started = time.perf_counter()
    felt = batch.follow(path)
    took = time.perf_counter() - started
    outputs()
    evaluations = felt.evaluations.sum(axis=0)
    row = {
        "device": device,
        "seed": seed,
        "edge [mm]": 1e3 * edge_m,
        "unknowns": model.pattern.dof_count,
        "friction": "0 to 1, half slide" if rubs else "none",
        "presses": count,
        "set-up [s]": set_up,
        "presses [s]": took,
        "with image, height map, tractions [s]": time.perf_counter() - started,
        "a press [ms]": 1e3 * took / count,
        "found": int(felt.valid.all(axis=0).sum()),
        "evaluations, mean": float(evaluations.mean()),
        "evaluations, median": float(np.median(evaluations)),
        "evaluations, 95 %": float(np.percentile(evaluations, 95.0)),
        "evaluations, most": int(evaluations.max()),
    }
    return row, felt[-1]


def unlike_table(rows: Sequence[Row]) -> Table:
    """Return what unlike presses take; all have to be found."""
    passed = all(row["found"] == row["presses"] for row in rows)
    return table_of_rows(rows, passed=passed, **_prose("unlike", seed=rows[0]["seed"]))


def draw_paths(pad: BoxPad, count: int, frame_count: int, *, seed: int) -> FloatArray:
    """Draw paths of tools in six degrees of freedom, shape [frame_count, count, 7]."""
    rng = np.random.default_rng(seed)
    half = np.array(pad.half_extents()) - _MARGIN_M - _AMPLITUDES[0]
    base = rng.uniform(-half, half, (count, 2))
    phase = rng.uniform(0.0, 2.0 * np.pi, (count, 6))
    speed = 2.0 * np.pi * rng.uniform(*_FREQUENCIES_HZ, (count, 6))
    time_s = np.arange(frame_count)[:, None, None] / _RATE_HZ
    moved = np.array(_AMPLITUDES) * np.sin(speed * time_s + phase)
    poses = np.zeros((frame_count, count, 7))
    poses[..., :2] = base + moved[..., :2]
    top = pad.height_at(poses[..., 0].ravel(), poses[..., 1].ravel()).reshape(frame_count, count)
    poses[..., 2] = top - _MEAN_DEPTH_M + moved[..., 2]
    turns = Rotation.from_rotvec(moved[..., 3:].reshape(-1, 3))
    poses[..., 3:] = turns.as_quat().reshape(frame_count, count, 4)
    return poses


def measure_moving(scene: Scene, *, seed: int = UNLIKE_SEED) -> Iterator[Row]:
    """Move drawn indenters over a scene's pad, along paths that are known and frame by frame."""
    device, pad, of = batch_device(), _box(scene), unlike_bodies()
    on_gpu = device != "cpu"
    for edge_m in _EDGES_M if on_gpu else _EDGES_M[:1]:
        model = sensor_model(pad, scene.material, edge_m=edge_m, device=device)
        for count, frame_count in _MOVING_ON_GPU if on_gpu else _MOVING_ON_CPU:
            which = np.random.default_rng(seed).integers(0, len(of), count)
            poses = draw_paths(pad, count, frame_count, seed=seed)
            for residual in _RESIDUALS:
                options = BatchOptions(residual_relative=residual)
                row = _moved(Batch(model, of, which, options=options), poses, residual, edge_m)
                yield {"seed": seed, **row}


def _moved(batch: Batch, poses: FloatArray, residual: float, edge_m: float) -> Row:
    frame_count, count, _ = poses.shape
    batch.follow(poses[:2])  # compiles its kernels
    batch.reset()
    batch.step(poses[0])
    batch.follow(poses[1:3])
    few = min(_FEW_FRAMES, frame_count - 3)
    started = time.perf_counter()
    for pose in poses[3 : 3 + few]:
        batch.step(pose)
    step_s = (time.perf_counter() - started) / few
    batch.reset()
    batch.step(poses[0])
    started = time.perf_counter()
    found = batch.follow(poses[1:])
    took = time.perf_counter() - started
    spent = found.evaluations.sum(axis=0)
    # The residual of a lighter contact is small enough by its size alone.
    touches = np.linalg.norm(found.raw_wrench[..., :3], axis=-1) > _FELT_N
    return {
        "edge [mm]": 1e3 * edge_m,
        "unknowns": batch.model.pattern.dof_count,
        "environments": count,
        "frames": frame_count - 1,
        "residual asked": residual,
        "frames/s, known path": (frame_count - 1) * count / took,
        "frames/s, step by step": count / step_s,
        LOST: int((~found.valid).sum()),
        "residual, most": float(found.residual[touches].max()),
        "imbalance, most": float(np.abs(found.imbalance[touches]).max()),
        "evaluations, mean": float(found.evaluations.mean()),
        "evaluations, most": int(found.evaluations.max()),
        "environments, slowest over mean": float(spent.max() / spent.mean()),
    }


def moving_table(rows: Sequence[Row]) -> Table:
    """Return what moving tools take; every frame has to be found, and in balance."""
    passed = all(row[LOST] == 0 and row["residual, most"] <= row["residual asked"] for row in rows)
    return table_of_rows(rows, passed=passed, **_prose("moving", seed=rows[0]["seed"]))


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
    found = []
    for body, pose in zip(bodies, poses, strict=True):
        depth_m = float(pad.height_at(pose[:1], pose[1:2])[0] - pose[2])
        own = replace(scene, indenter=body, target=Target(depth_m=depth_m))
        found.append(press_alone(own, pose[:2], pose[3:], tolerance))
    forces, poses = np.array([force for force, _ in found]), np.array([at for _, at in found])
    for edge_m in edges_m:
        model = sensor_model(pad, scene.material, edge_m=edge_m)
        felt = Batch(model, bodies, range(count)).step(poses)
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


def alone_table(rows: Sequence[Row]) -> Table:
    """Return how far the forces are off; the finest mesh's are to be close."""
    finest = min(rows, key=lambda row: row["edge [mm]"])
    passed = finest["found"] == finest["presses"] and finest[WITHIN] >= WITHIN_WANTED
    prose = _prose("alone", seed=ALONE_SEED, wanted=WITHIN_WANTED, tolerance=TOLERANCE)
    return table_of_rows(rows, passed=passed, **prose)
