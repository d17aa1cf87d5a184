"""Shards of a sweep: pressed as batches, and kept as Parquet with an index."""

import hashlib
import json
import resource
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial.transform import Rotation

from sim.batch.batch import Batch
from sim.batch.sensor_model import sensor_model
from sim.contact.first_touch import first_touch
from sim.fields.saved_press import top_surface
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import IndenterSet, describe, tilted
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Effect
from sim.sensor.sensor import Sensor
from sim.solve.model import Model
from tacauchy_rig.app.sweep.plan import (
    Plan,
    Row,
    Simulation,
    drawn_with,
    indenter_of,
    made_with,
    sensor_of,
)
from tacauchy_rig.core.arrays import AnyArray, FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.versions import library

# Where a press by force begins, below first touch [m].
_FIRST_M = 0.05e-3
# Edges for presses that state too large an error, over the plan's edge, and the shortest [m].
_FINER, _EDGE_LEAST_M = 0.5 ** np.array([0.5, 1.0]), 0.5e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Shard:
    """Some rows of one sensor, with friction or without."""

    name: str  # hash of its rows and of all that they depend on
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


def compute_shard(
    rows: Sequence[Row], simulation: Simulation, *, device: str = "cpu"
) -> tuple[dict[str, AnyArray], dict[str, float]]:
    """Press a shard's rows; those that state too large an error again, on finer meshes that fit.

    Args:
        rows: Of one sensor and either all with friction or all without.

    Returns:
        By name, arrays with one entry a press in front: ``wrench`` [N, N m], ``force_error`` (a
        share), ``contact_area_m2``, ``depth_m``, ``valid``, ``evaluations``, ``edge_m``, ``image``
        (RGB, before light and noise), ``indentation_mm`` float16 [height, width], ``pressure_pa``
        [rows, columns], ``shear_pa`` [rows, columns, 2], ``markers_px`` [markers, 2]; and the
        seconds that ``setup`` (mesh, its inverse), ``solve`` and ``render`` took.
    """
    arrays, took = _pressed(rows, simulation, simulation.edge, device)
    for edge_m in (simulation.edge * _FINER[_FINER * simulation.edge >= _EDGE_LEAST_M]).tolist():
        poor = np.flatnonzero(arrays["force_error"] > simulation.tolerance)
        if not len(poor):
            break
        with suppress(ConfigError):
            again, further = _pressed([rows[k] for k in poor.tolist()], simulation, edge_m, device)
            found = again["valid"]
            for name, values in again.items():
                arrays[name][poor[found]] = values[found]
            took = {name: seconds + further[name] for name, seconds in took.items()}
    return arrays, took


def _pressed(
    rows: Sequence[Row], simulation: Simulation, edge_m: float, device: str
) -> tuple[dict[str, AnyArray], dict[str, float]]:
    """Press rows on a mesh; returns what ``compute_shard`` does."""
    started = time.monotonic()
    sensor, count = sensor_of(rows[0].sensor), len(rows)
    model = _model(rows[0].sensor, edge_m, rows[0].friction > 0.0, device)
    names = list(dict.fromkeys(row.indenter for row in rows))
    bodies, which = [indenter_of(name) for name in names], [names.index(r.indenter) for r in rows]
    batch = Batch(
        model,
        bodies,
        which,
        friction=np.array([row.friction for row in rows]) if rows[0].friction else None,
        materials=[_gel(sensor, row.material) for row in rows],
    )
    ready = time.monotonic()
    pressing = IndenterSet(bodies=tuple(bodies), which=tuple(which))
    places = np.array([(row.x_m, row.y_m) for row in rows])
    turns = np.array([tilted(row.tilt_x_rad, row.tilt_y_rad) for row in rows])
    touch_m = first_touch(sensor.pad, pressing, places, turns, device=device)
    loads = [row.force_n for row in rows]
    poses = _poses(rows, places, touch_m, Rotation.from_matrix(turns))
    found = batch.follow(
        poses, loads_n=None if loads[0] is None else np.tile(np.array(loads), (len(poses), 1))
    )[-1]
    tractions = [field.numpy() for field in batch.tractions()]
    solved = time.monotonic()
    optics, frame = drawn_with(rows[0].sensor, simulation)
    drawing = SurfaceImages(
        model,
        batch.descents.indenter,
        replace(sensor, optics=replace(sensor.optics, shadows=optics.shadows)),
        count=count,
        samples=simulation.samples,
        background=None if simulation.background is None else frame,
        colours=optics.model,
        geometry=optics.geometry,
        blur_px=optics.blur_px,
    )
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
        "edge_m": np.full(count, edge_m),
        "image": images,
        "indentation_mm": dents.astype(np.float16),
        "pressure_pa": pressure,
        "shear_pa": shear,
        "markers_px": markers.astype(np.float32),
    }
    took = {"setup": ready - started, "solve": solved - ready}
    return arrays, took | {"render": time.monotonic() - solved}


@lru_cache(maxsize=6)
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


def _poses(rows: Sequence[Row], at: FloatArray, touch_m: FloatArray, turns: Rotation) -> FloatArray:
    """Return the way of every indenter: pressed in, then moved along, shape [frames, count, 7]."""
    ways = np.array([(row.shift_x_m, row.shift_y_m) for row in rows])
    depths = np.array([_FIRST_M if row.depth_m is None else row.depth_m for row in rows])
    twists = Rotation.from_rotvec(np.outer([row.twist_rad for row in rows], [0.0, 0.0, 1.0]))
    down = np.column_stack([at, touch_m - depths, turns.as_quat()])
    along = np.column_stack([at + ways, touch_m - depths, (twists * turns).as_quat()])
    return np.stack([down] if np.array_equal(down, along) else [down, along])


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


SHARDS = "shards"
WRENCH = ("force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm")
LARGE = ("image", "reference", "indentation_mm", "pressure_pa", "shear_pa", "markers_px")
"""Columns of the shards that the index leaves out."""
# What batches of presses compute with; friction where a row has some, layers where the gel has.
_EFFECTS = {Effect.FINITE_STRAIN, Effect.LOCKING_FREE_ELEMENT}


def parquet() -> Any:
    """Return ``pyarrow`` with its Parquet; raises as ``library``."""
    library("pyarrow.parquet", extra="sweep")
    return library("pyarrow", extra="sweep")


class Made(NamedTuple):
    """A shard's file; what it took.

    Attributes:
        content: The file.
        took_s: In ``setup``, ``solve``, ``render`` and ``write`` [s].
        peak_bytes: The most memory that its process has used so far.
    """

    content: bytes
    took_s: dict[str, float]
    peak_bytes: float


def make_shard(shard: Shard, device: str) -> Made:
    """Press a shard and return its file; what every engine calls."""
    pa = parquet()  # its import is no writing
    arrays, took_s = compute_shard(shard.rows, shard.simulation, device=device)
    started = time.monotonic()
    _optics, frame = drawn_with(shard.rows[0].sensor, shard.simulation)
    presses = enumerate(zip(shard.rows, shard.hashes, strict=True))
    columns = [_columns(*each, arrays, frame) for each in presses]
    table = {name: [row[name] for row in columns] for name in columns[0]}
    made: dict[str, Any] = {name: pa.array(values) for name, values in table.items()}
    fields = [pa.field(name, values.type) for name, values in made.items()]
    for name in LARGE[2:]:
        made[name] = lists(arrays[name])
        shape = {"shape": json.dumps(arrays[name].shape[1:])}
        fields.append(pa.field(name, made[name].type, metadata=shape))
    sink = pa.BufferOutputStream()
    whole = pa.table(list(made.values()), schema=pa.schema(fields))
    pa.parquet.write_table(whole, sink, compression="zstd", row_group_size=50, use_dictionary=False)
    peak_bytes = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    took_s |= {"write": time.monotonic() - started}
    return Made(bytes(sink.getvalue()), took_s, peak_bytes)


def lists(values: AnyArray) -> Any:
    """Return a column with one flat list for each row of ``values``, shape [row_count, ...].

    A sensor without markers has empty lists, which Arrow does not take as lists of one size.
    """
    pa, size = parquet(), int(np.prod(values.shape[1:]))
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    if size == 0:
        return pa.ListArray.from_arrays(np.zeros(len(values) + 1, np.int32), flat)
    return pa.FixedSizeListArray.from_arrays(flat, size)


def _columns(
    place: int, of: tuple[Row, str], arrays: Mapping[str, AnyArray], frame: ImageArray
) -> dict[str, Any]:
    """Return what is no field of a press: inputs, sums, and both images."""
    row, name = of
    area, found = float(arrays["contact_area_m2"][place]), bool(arrays["valid"][place])
    reason = "" if found else "no equilibrium was found"
    if found and not area > 0.0:
        reason = "the indenter does not touch the gel"
    elif found and not arrays["wrench"][place][2] > 0.0:
        reason = "F_z is not positive, though the gel does not adhere"
    on = _EFFECTS | ({Effect.FRICTION} if row.friction else set())
    on |= {Effect.SECOND_LAYER} if sensor_of(row.sensor).layers else set()
    episode = f"{row.sensor} {row.light!r} {row.noise!r}"
    return {
        "hash": name,
        **{key: value for key, value in asdict(row).items() if key not in ("depth_m", "force_n")},
        "indenter": shown(row.indenter),
        "object": shown(row.object),
        "commanded_depth_m": row.depth_m,
        "commanded_force_n": row.force_n,
        "depth_m": float(arrays["depth_m"][place]),
        **dict(zip(WRENCH, arrays["wrench"][place].tolist(), strict=True)),
        "force_error": float(arrays["force_error"][place]),
        "contact_area_m2": area,
        "contact_radius_m": float(np.sqrt(area / np.pi)),
        "valid": not reason,
        "reason": reason,
        "evaluations": int(arrays["evaluations"][place]),
        "edge_m": float(arrays["edge_m"][place]),
        "effects": json.dumps({effect.value: effect in on for effect in Effect}),
        "versions": json.dumps(made_with()),
        "image": _photograph(arrays["image"][place], row, name),
        "reference": _photograph(frame, row, episode),
    }


def shown(text: str) -> str:
    """Return an indenter without the folder of its file."""
    return describe(indenter_of(text)) if text.startswith("mesh:") else text


def _photograph(frame: ImageArray, row: Row, seed: str) -> bytes:
    """Return a rendered frame under a row's light and with its noise, as PNG."""
    if row.light == 1.0 and row.noise == 0.0:
        return encode_png(frame)
    levels = frame * row.light
    if row.noise:
        number = int.from_bytes(hashlib.sha256(seed.encode()).digest()[:8], "big")
        levels = levels + row.noise * np.random.default_rng(number).standard_normal(frame.shape)
    return encode_png(np.clip(np.rint(levels), 0, 255).astype(np.uint8))
