"""What of a sweep is done already: an interrupted one goes on from there."""

from pathlib import Path

from tacauchy_rig.app.sweep.shards import SHARDS, parquet
from tacauchy_rig.core.errors import RecordError


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
