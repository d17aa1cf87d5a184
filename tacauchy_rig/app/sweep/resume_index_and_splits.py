"""What of a sweep is done already, and the index of its presses, split into training and tests."""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tacauchy_rig.app.sweep.engine_names import INDEX
from tacauchy_rig.app.sweep.plan import Row
from tacauchy_rig.app.sweep.shards import LARGE, SHARDS, parquet, shown
from tacauchy_rig.core.errors import whole
from tacauchy_rig.core.store.atomic_write import write_atomically

# Of places and of objects that tests are to be of; and the size of a place [m].
_TEST_SHARE, _PLACE_M = 0.2, 2e-3


def done_rows(folder: Path) -> dict[str, tuple[str, int]]:
    """Return of every row that was computed its shard's file and its place there, by hash.

    Raises:
        RecordError: A shard is damaged.
    """
    found: dict[str, tuple[str, int]] = {}
    for file in sorted((folder / SHARDS).glob("*.parquet")):
        remedy = "delete this file; the sweep computes it again"
        with whole(str(file), "shard of a sweep", remedy=remedy):
            names = parquet().parquet.read_table(file, columns=["hash"])["hash"].to_pylist()
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
    places = [f"{row.x_m // _PLACE_M:g},{row.y_m // _PLACE_M:g}" for row in rows.values()]
    further = {
        "shard": [f"{SHARDS}/{at[name][0]}" for name in rows],
        "offset": [at[name][1] for name in rows],
        "split_place": splits(places),
        "split_object": splits(shown(r.object) for r in rows.values()),
    }
    for name, values in further.items():
        table = table.append_column(name, pa.array(values))
    sink = pa.BufferOutputStream()
    pa.parquet.write_table(table, sink, compression="zstd")
    write_atomically(folder / INDEX, bytes(sink.getvalue()))
    return table


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
