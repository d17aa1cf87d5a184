"""The files of a sweep: shards and their index, as Parquet."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sim.scene.indenter import describe
from sim.scene.scene import Effect
from tacauchy_rig.app.sweep.names import INDEX
from tacauchy_rig.app.sweep.rows import Row, drawn_with, indenter_of, made_with, sensor_of
from tacauchy_rig.app.sweep.shard import Shard, compute_shard
from tacauchy_rig.core.arrays import AnyArray, ImageArray
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.rgb import encode_png
from tacauchy_rig.core.store.durable import write_atomically

SHARDS = "shards"
WRENCH = ("force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm")
LARGE = ("image", "reference", "indentation_mm", "pressure_pa", "shear_pa", "markers_px")
"""Columns of the shards that the index leaves out."""
# Of places and of objects that tests are to be of; and the size of a place [m].
_TEST_SHARE, _PLACE_M = 0.2, 2e-3
# What batches of presses compute with; friction where a row has some, layers where the gel has.
_EFFECTS = {Effect.FINITE_STRAIN, Effect.LOCKING_FREE_ELEMENT}


def parquet() -> Any:
    """Return ``pyarrow`` with its Parquet.

    Raises:
        ConfigError: It is not installed.
    """
    try:
        import pyarrow  # noqa: PLC0415 - an extra
        import pyarrow.parquet  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ConfigError(
            "a sweep needs pyarrow, which is not installed",
            remedy="install the extra: pip install 'tacauchy-rig[sweep]'",
        ) from error
    return pyarrow


def make_shard(shard: Shard, device: str) -> bytes:
    """Press a shard and return its file; what every engine calls."""
    arrays, _took = compute_shard(shard.rows, shard.simulation, device=device)
    return encoded(shard, arrays)


def encoded(shard: Shard, arrays: Mapping[str, AnyArray]) -> bytes:
    """Return a shard's file from what ``compute_shard`` gives."""
    pa = parquet()
    _optics, frame = drawn_with(shard.rows[0].sensor, shard.simulation)
    columns = [
        _columns(*each, arrays, frame)
        for each in enumerate(zip(shard.rows, shard.hashes, strict=True))
    ]
    table = {name: [row[name] for row in columns] for name in columns[0]}
    made: dict[str, Any] = {name: pa.array(values) for name, values in table.items()}
    fields = [pa.field(name, values.type) for name, values in made.items()]
    for name in LARGE[2:]:
        value = arrays[name]
        flat = pa.array(np.ascontiguousarray(value).reshape(-1))
        size = int(np.prod(value.shape[1:]))
        made[name] = pa.FixedSizeListArray.from_arrays(flat, size)
        shape = {"shape": json.dumps(value.shape[1:])}
        fields.append(pa.field(name, made[name].type, metadata=shape))
    sink = pa.BufferOutputStream()
    whole = pa.table(list(made.values()), schema=pa.schema(fields))
    pa.parquet.write_table(whole, sink, compression="zstd", row_group_size=50, use_dictionary=False)
    return bytes(sink.getvalue())


def _columns(
    place: int, of: tuple[Row, str], arrays: Mapping[str, AnyArray], frame: ImageArray
) -> dict[str, Any]:
    """Return what is no field of a press: inputs, sums, and both images."""
    row, name = of
    area, valid = float(arrays["contact_area_m2"][place]), bool(arrays["valid"][place])
    episode = f"{row.sensor} {row.light!r} {row.noise!r}"
    return {
        "hash": name,
        **{key: value for key, value in asdict(row).items() if key not in ("depth_m", "force_n")},
        "indenter": _shown(row.indenter),
        "object": _shown(row.object),
        "commanded_depth_m": row.depth_m,
        "commanded_force_n": row.force_n,
        "depth_m": float(arrays["depth_m"][place]),
        **dict(zip(WRENCH, arrays["wrench"][place].tolist(), strict=True)),
        "force_error": float(arrays["force_error"][place]),
        "contact_area_m2": area,
        "contact_radius_m": float(np.sqrt(area / np.pi)),
        "valid": valid and area > 0.0,
        "reason": "" if valid and area > 0.0 else _why(valid),
        "evaluations": int(arrays["evaluations"][place]),
        "edge_m": float(arrays["edge_m"][place]),
        "effects": json.dumps(_effects(row)),
        "versions": json.dumps(made_with()),
        "image": _photograph(arrays["image"][place], row, name),
        "reference": _photograph(frame, row, episode),
    }


def _why(found: bool) -> str:
    return "the indenter does not touch the gel" if found else "no equilibrium was found"


def _shown(text: str) -> str:
    """Return an indenter without the folder of its file."""
    return describe(indenter_of(text)) if text.startswith("mesh:") else text


def _effects(row: Row) -> dict[str, bool]:
    has_layers = bool(sensor_of(row.sensor).layers)
    on = _EFFECTS | ({Effect.FRICTION} if row.friction else set())
    on |= {Effect.SECOND_LAYER} if has_layers else set()
    return {effect.value: effect in on for effect in Effect}


def _photograph(frame: ImageArray, row: Row, seed: str) -> bytes:
    """Return a rendered frame under a row's light and with its noise, as PNG."""
    if row.light == 1.0 and row.noise == 0.0:
        return encode_png(frame)
    levels = frame * row.light
    if row.noise:
        number = int.from_bytes(hashlib.sha256(seed.encode()).digest()[:8], "big")
        levels = levels + row.noise * np.random.default_rng(number).standard_normal(frame.shape)
    return encode_png(np.clip(np.rint(levels), 0, 255).astype(np.uint8))


def done_rows(folder: Path) -> dict[str, tuple[str, int]]:
    """Return of every row that was computed its shard's file and its place there, by hash.

    Raises:
        RecordError: A shard is damaged.
    """
    found: dict[str, tuple[str, int]] = {}
    for file in sorted((folder / SHARDS).glob("*.parquet")):
        try:
            names = parquet().parquet.read_table(file, columns=["hash"])["hash"].to_pylist()
        except (OSError, KeyError, ValueError) as error:
            raise RecordError(
                f"{file}: is no shard of a sweep: {error}",
                remedy="delete this file; the sweep computes it again",
            ) from error
        found |= {name: (file.name, place) for place, name in enumerate(names)}
    return found


def write_index(folder: Path, rows: Mapping[str, Row]) -> Any:
    """Write one row a press, in the plan's order, and return the table; all shards are there."""
    pa, at = parquet(), done_rows(folder)
    files = sorted({at[name][0] for name in rows})
    scalars = [_scalars(folder / SHARDS / name) for name in files]
    every = pa.concat_tables(scalars)
    place = {name: number for number, name in enumerate(every["hash"].to_pylist())}
    table = every.take([place[name] for name in rows])
    further = {
        "shard": [f"{SHARDS}/{at[name][0]}" for name in rows],
        "offset": [at[name][1] for name in rows],
        "split_place": splits(map(_place, rows.values())),
        "split_object": splits(_shown(r.object) for r in rows.values()),
    }
    for name, values in further.items():
        table = table.append_column(name, pa.array(values))
    sink = pa.BufferOutputStream()
    pa.parquet.write_table(table, sink, compression="zstd")
    write_atomically(folder / INDEX, bytes(sink.getvalue()))
    return table


def _place(row: Row) -> str:
    return f"{row.x_m // _PLACE_M:g},{row.y_m // _PLACE_M:g}"


def _scalars(file: Path) -> Any:
    reader = parquet().parquet
    names = [name for name in reader.read_schema(file).names if name not in LARGE]
    return reader.read_table(file, columns=names).replace_schema_metadata(None)


def splits(groups: Iterable[str]) -> list[str]:
    """Return ``test`` for the members of a fifth of the groups, chosen by their hashes."""
    members = list(groups)
    names = sorted(set(members), key=lambda name: hashlib.sha256(name.encode()).digest())
    test = set(names[: max(1, round(_TEST_SHARE * len(names)))]) if len(names) > 1 else set()
    return ["test" if name in test else "train" for name in members]


def checksums(folder: Path, files: Sequence[Path]) -> dict[str, str]:
    """Return the SHA-256 of files, by their paths in a folder."""
    sums = {}
    for file in files:
        with file.open("rb") as content:
            sums[str(file.relative_to(folder))] = hashlib.file_digest(content, "sha256").hexdigest()
    return sums
