"""Forces of a batch on a sensor's mesh against presses on fine meshes of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.batch.sensor_batch import SensorBatch, sensor_model
from sim.error import Tolerance, keeping_corrected
from sim.press import press
from sim.scene.indenter import Cylinder, Indenter, Sphere, tilted
from sim.scene.pad import BoxPad
from sim.scene.scene import Motion, Scene, Target
from sim.studies.bench.parts import Row
from sim.studies.bench.unlike import draw_poses
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

SEED, _COUNT = 90210, 40
TOLERANCE = 0.01
_EDGES_M = (2.5e-3, 1.7e-3, 1.25e-3)
WITHIN, HOLDS = "within 5 % [%]", "within what is stated [%]"
WITHIN_WANTED, _NEAR = 90.0, 0.05


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


def measure_alone(
    scene: Scene,
    *,
    count: int = _COUNT,
    seed: int = SEED,
    edges_m: Sequence[float] = _EDGES_M,
    tolerance: float = TOLERANCE,
) -> Iterator[Row]:
    """Press each alone, to a tolerance of F_z, then all in batches at the same heights."""
    pad = scene.pad
    assert isinstance(pad, BoxPad)  # noqa: S101 - every sensor's is
    bodies = rounded_bodies(count, seed=seed)
    _, poses = draw_poses(pad, bodies, count, seed=seed, which=np.arange(count, dtype=np.int32))
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
    prose = table_prose(
        "sim.studies.bench",
        "tables.md.jinja",
        "alone",
        seed=SEED,
        wanted=WITHIN_WANTED,
        tolerance=TOLERANCE,
    )
    return table_of_rows(rows, passed=passed, **prose)
