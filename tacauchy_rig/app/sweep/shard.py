"""One shard: presses that are computed together, on a CPU or a GPU, as plain arrays."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial.transform import Rotation

from sim.batch.batch import Batch
from sim.batch.sensor_model import sensor_model
from sim.fields.press_fields import top_surface
from sim.optics.render.renderer import GREY_LEVEL
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import TurnedIndenter, tilted
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.sensor.sensor import Sensor
from sim.solve.model import Model
from tacauchy_rig.app.sweep.plan import Plan, Simulation
from tacauchy_rig.app.sweep.rows import Row, indenter_of, row_hash, sensor_of
from tacauchy_rig.core.arrays import AnyArray, FloatArray

# Where a press by force begins, below first touch [m].
_FIRST_M = 0.05e-3
# Points of a grid, both ways, on which first touch is sought, and how often around the best.
_POINTS, _ROUNDS = 61, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Shard:
    """Some rows of one sensor, with friction or without.

    Attributes:
        name: Hash of its rows and of all that they depend on.
    """

    name: str
    rows: tuple[Row, ...]
    hashes: tuple[str, ...]
    simulation: Simulation


def shards_of(plan: Plan, rows: Mapping[str, Row], done: set[str]) -> Iterator[Shard]:
    """Yield what is left to compute, in blocks of the plan's size.

    Rows that are done leave the others' blocks as they were, as long as whole blocks are done: so
    a sweep that was interrupted, or that others work on, goes on with the blocks that it had.

    Args:
        rows: By hash, in the plan's order.
        done: Hashes of rows that there are results of.
    """

    def kind(item: tuple[str, Row]) -> tuple[str, bool]:
        return item[1].sensor, item[1].friction > 0.0

    size, left = plan.simulation.shard, [item for item in rows.items() if item[0] not in done]
    for _, group in groupby(sorted(left, key=kind), key=kind):
        block = list(group)
        for first in range(0, len(block), size):
            hashes, members = zip(*block[first : first + size], strict=True)
            name = hashlib.sha256("".join(hashes).encode()).hexdigest()[:32]
            yield Shard(name=name, rows=members, hashes=hashes, simulation=plan.simulation)


def hashed(plan: Plan, rows: Sequence[Row]) -> dict[str, Row]:
    """Return rows by their hashes."""
    return {row_hash(row, plan.simulation): row for row in rows}


def compute_shard(
    rows: Sequence[Row], simulation: Simulation, *, device: str = "cpu"
) -> tuple[dict[str, AnyArray], dict[str, float]]:
    """Press a shard's rows.

    Args:
        rows: Of one sensor and either all with friction or all without.

    Returns:
        By name, arrays with one entry a press in front: ``wrench`` [N, N m], ``force_error`` (a
        share), ``contact_area_m2``, ``depth_m``, ``valid``, ``evaluations``, ``image`` (RGB, before
        light and noise), ``indentation_mm`` float16 [height, width], ``pressure_pa`` [rows,
        columns], ``shear_pa`` [rows, columns, 2], ``markers_px`` [markers, 2]; and the seconds
        that ``mesh``, ``solve`` and ``render`` took.
    """
    started = time.monotonic()
    sensor, count = sensor_of(rows[0].sensor), len(rows)
    model = _model(rows[0].sensor, simulation.edge, rows[0].friction > 0.0, device)
    bodies = list(dict.fromkeys(row.indenter for row in rows))
    batch = Batch(
        model,
        [indenter_of(body) for body in bodies],
        [bodies.index(row.indenter) for row in rows],
        friction=np.array([row.friction for row in rows]) if rows[0].friction else None,
        materials=[_gel(sensor, row.material) for row in rows],
    )
    meshed = time.monotonic()
    touch_m = np.array([_touch_m(sensor.pad, row) for row in rows])
    loads = [row.force_n for row in rows]
    poses = _poses(rows, touch_m)
    found = batch.follow(
        poses, loads_n=None if loads[0] is None else np.tile(np.array(loads), (len(poses), 1))
    )[-1]
    tractions = [field.numpy() for field in batch.tractions()]
    solved = time.monotonic()
    pressing: Any = batch.descents.indenter
    drawing = SurfaceImages(model, pressing, sensor, count=count, samples=simulation.samples)
    images = drawing.images(batch.positions, batch.poses.tips, batch.poses.rotations).numpy()
    markers = drawing.markers(batch.positions).numpy()
    dents = _halved(drawing.dents.numpy(), simulation.samples) * 1e3
    pressure, shear = _on_grid(model, sensor, simulation.cell, *tractions)
    arrays = {
        "wrench": found.wrench,
        "force_error": found.force_error,
        "contact_area_m2": found.contact_area_m2,
        "depth_m": touch_m - found.tips_m[:, 2],
        "valid": found.valid,
        "evaluations": found.evaluations,
        "image": images,
        "indentation_mm": dents.astype(np.float16),
        "pressure_pa": pressure,
        "shear_pa": shear,
        "markers_px": markers.astype(np.float32),
    }
    took = {"mesh": meshed - started, "solve": solved - meshed}
    return arrays, took | {"render": time.monotonic() - solved}


def bare_frame(sensor: Sensor) -> AnyArray:
    """Return the no-contact frame that images are drawn over, RGB, before light and noise."""
    return np.full((sensor.camera.height, sensor.camera.width, 3), GREY_LEVEL, dtype=np.uint8)


@lru_cache(maxsize=2)
def _model(sensor: str, edge_m: float, has_friction: bool, device: str) -> Model:
    own = sensor_of(sensor)
    assert isinstance(own.pad, BoxPad)  # noqa: S101 - the plan was checked
    friction = 1.0 if has_friction else 0.0  # every row has its own
    return sensor_model(
        own.pad, own.material, layers=own.layers, edge_m=edge_m, friction=friction, device=device
    )


def _gel(sensor: Sensor, factor: float) -> list[Material]:
    gel = sensor.stiffer(factor)
    return [layer.material for layer in gel.layers] or [gel.material]


def _poses(rows: Sequence[Row], touch_m: FloatArray) -> FloatArray:
    """Return the way of every indenter: pressed in, then moved along, shape [frames, count, 7]."""
    down, along = np.zeros((2, len(rows), 7))
    for row, touch, pressed, moved in zip(rows, touch_m, down, along, strict=True):
        turn = Rotation.from_matrix(tilted(row.tilt_x_rad, row.tilt_y_rad))
        z = touch - (_FIRST_M if row.depth_m is None else row.depth_m)
        pressed[:] = row.x_m, row.y_m, z, *turn.as_quat()
        twisted = Rotation.from_rotvec([0.0, 0.0, row.twist_rad]) * turn
        moved[:] = row.x_m + row.shift_x_m, row.y_m + row.shift_y_m, z, *twisted.as_quat()
    moves = any(row.shift_x_m or row.shift_y_m or row.twist_rad for row in rows)
    return np.stack([down, along] if moves else [down])


def _touch_m(pad: Any, row: Row) -> float:
    """Return the height of the tip at which an indenter first touches the resting gel [m]."""
    rotation = tilted(row.tilt_x_rad, row.tilt_y_rad)
    body = TurnedIndenter(indenter=indenter_of(row.indenter), rotation=rotation)
    half = pad.half_extents()
    centre = np.array([row.x_m, row.y_m])
    low, high = (np.clip(centre + end, *_signed(half)) for end in body.reach())
    for _ in range(_ROUNDS):
        x, y = np.meshgrid(*(np.linspace(a, b, _POINTS) for a, b in zip(low, high, strict=True)))
        reached = pad.height_at(x, y) - body.lower_surface(x - centre[0], y - centre[1])
        best, step = np.argmax(reached), (high - low) / (_POINTS - 1)
        at = np.array([x.flat[best], y.flat[best]])
        low, high = np.clip(at - step, *_signed(half)), np.clip(at + step, *_signed(half))
    return float(reached.flat[best])


def _signed(half: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    return -np.asarray(half), np.asarray(half)


def _halved(fine: AnyArray, samples: int) -> AnyArray:
    """Return the mean over each pixel's samples."""
    count, rows, columns = fine.shape
    parts = fine.reshape(count, rows // samples, samples, columns // samples, samples)
    return np.asarray(parts.mean(axis=(2, 4)))


def _on_grid(
    model: Model, sensor: Sensor, cell: int, pressure: FloatArray, shear: FloatArray
) -> tuple[AnyArray, AnyArray]:
    """Return pressure and shear of the gel that the camera sees at rest, on a grid of cells."""
    top, view = top_surface(model), sensor.camera.refined(1.0 / cell)
    at = np.stack(view.pad_grid(), axis=-1)
    nodal = np.concatenate([pressure[..., None], shear[..., :2]], axis=-1)[:, top.sources]
    flat = nodal.transpose(1, 0, 2).reshape(len(top.sources), -1)
    drawn = LinearNDInterpolator(top.rest[:, :2], flat, fill_value=0.0)(at)
    grid = drawn.reshape(*at.shape[:2], len(pressure), 3).transpose(2, 0, 1, 3).astype(np.float32)
    return grid[..., 0], grid[..., 1:]
