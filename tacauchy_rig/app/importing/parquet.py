"""Columns of a Parquet file, bounded; ``pyarrow`` reads it, an extra of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from tacauchy_rig.app.importing.source import MIB, Source
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError, RecordError

if TYPE_CHECKING:
    import pyarrow

FILE_BYTES = 1024 * MIB
UNPACKED_BYTES = 4096 * MIB
"""Of the columns that are read, as the file's foot says."""
ROWS_MOST = 2_000_000
EXTRA = "lerobot"


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of some columns.

    Attributes:
        name: Of the file, for messages.
        table: As Arrow has them.
    """

    name: str
    table: pyarrow.Table

    def rows(self) -> Iterator[Mapping[str, Any]]:
        """Yield each row by column."""
        yield from self.table.to_pylist()

    def numbers(self, column: str) -> FloatArray:
        """Return a column of numbers, or of lists of as many numbers each, shape [n, k].

        Raises:
            RecordError: It holds something else, or values that are no finite numbers.
        """
        cells = self.table.column(column).to_pylist()
        try:
            values = np.array(cells, dtype=np.float64).reshape(len(cells), -1)
        except (TypeError, ValueError) as error:
            raise RecordError(
                f"{self.name}: {column}: no numbers, or not as many in each row",
                remedy="name a feature of numbers",
            ) from error
        if not np.isfinite(values).all():
            raise RecordError(
                f"{self.name}: {column}: holds values that are no finite numbers",
                remedy="leave these episodes out",
            )
        return values

    def image(self, column: str, row: int, *, most_bytes: int) -> bytes:
        """Return the bytes of an image that stands in a cell.

        Raises:
            RecordError: There are none, or too many.
        """
        cell = self.table.column(column)[row].as_py()
        data = cell.get("bytes") if isinstance(cell, dict) else None
        if not isinstance(data, bytes) or not 0 < len(data) <= most_bytes:
            raise RecordError(
                f"{self.name}: {column}, row {row}: holds no image's bytes",
                remedy="images have to lie within the file; paths to others are not followed",
            )
        return data


def read_parquet(
    source: Source, name: str, columns: Sequence[str], *, where: tuple[str, int] | None = None
) -> Rows:
    """Return columns of a file, and of them the rows whose column has a value.

    Raises:
        RecordError: It is none, lacks a column, or unpacks to too much.
        ConfigError: ``pyarrow`` is not there.
    """
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError as error:
        raise ConfigError(
            f"{name}: Parquet is read by pyarrow, which is not installed",
            remedy=f'pip install "tacauchy-rig[{EXTRA}]", or: pip install pyarrow',
        ) from error
    path = source.path(name, field="the dataset", most_bytes=FILE_BYTES)
    try:
        with parquet.ParquetFile(path) as file:
            _check_size(file, name, columns)
            table = file.read(columns=list(columns), use_threads=False)
        if where is not None:
            kept = np.flatnonzero(np.asarray(table.column(where[0])) == where[1])
            table = table.take(kept)
    except (arrow.ArrowException, OSError, ValueError, MemoryError) as error:
        raise RecordError(
            f"{name}: no whole Parquet file: {str(error)[:200]}",
            remedy="copy it anew from its source",
        ) from error
    return Rows(name, table)


def _check_size(file: Any, name: str, columns: Sequence[str]) -> None:
    """Refuse what the file's foot says to be too large, before anything of it is unpacked."""
    foot = file.metadata
    there = set(file.schema_arrow.names)
    if missing := [each for each in columns if each not in there]:
        raise RecordError(
            f"{name}: has no column {', '.join(missing)[:200]}",
            remedy=f"its columns: {', '.join(file.schema_arrow.names)[:300]}",
        )
    groups = [foot.row_group(k) for k in range(foot.num_row_groups)]
    size = sum(
        group.column(k).total_uncompressed_size
        for group in groups
        for k in range(group.num_columns)
        if group.column(k).path_in_schema.partition(".")[0] in columns
        or group.column(k).path_in_schema in columns
    )
    if foot.num_rows > ROWS_MOST or not 0 <= size <= UNPACKED_BYTES:
        raise RecordError(
            f"{name}: {foot.num_rows} rows of {size} bytes; at most {ROWS_MOST} of "
            f"{UNPACKED_BYTES} are read",
            remedy="split the dataset",
        )
