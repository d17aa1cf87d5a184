"""A folder of NumPy records, one a press: ``.npz`` of arrays by name, or a structured ``.npy``.

FEATS' records hold so an image, the indenter's place and way, and the cell's forces (Helmut et al.,
arXiv 2411.03315). As they are published they are pickles, which are never loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import PurePath

import numpy as np

from tacauchy_rig.app.importing.presses import Recorded
from tacauchy_rig.app.importing.rows import RowsData, image_files, presses_of
from tacauchy_rig.app.importing.source import (
    IMAGE_PIXELS,
    MIB,
    Source,
    array_names,
    read_npy,
    read_npz,
)
from tacauchy_rig.app.importing.table import Column, Table
from tacauchy_rig.core.arrays import AnyArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import ColourOrder, encode_png

Record = Mapping[str, AnyArray]
NPY, NPZ = ".npy", ".npz"
RECORD_BYTES = 256 * MIB
"""Of a record: an image and some maps of forces are a few."""
RECORDS_MOST = 10_000
"""Of a folder, of which a run takes a few."""
_PRESS, _INDENTER = "(record)", "(indenter)"
"""Columns that no key of a record makes; no key is written so."""


class RecordsData(RowsData):
    """``[data]`` of a folder of records; a column is a key of each record."""

    colour_order: ColourOrder
    records: str = "."
    starts: str = ""
    still: tuple[str, ...] = ()


def read_records(source: Source, data: RecordsData) -> Recorded:
    """Read a folder of records.

    Raises:
        RecordError: A record is damaged, of Python objects, or lacks a key.
        ConfigError: A unit is not of what it is to measure.
    """
    names, rows = _names(source, data), []
    for name in names:
        with source.problems.noting():
            rows += _rows(_read(source, name), name, data)
    source.problems.refuse()
    if not rows:
        raise RecordError(
            f"data.records: all of {len(names)} records move aside or turn",
            remedy="a replay presses straight: name straight presses, or correct data.still",
        )
    columns = {key: k for k, key in enumerate(dict.fromkeys(key for row in rows for key in row))}
    table = Table(
        name=f"records of {data.records}",
        columns=columns,
        rows=[[row.get(key, "") for key in columns] for row in rows],
        places=[row[_PRESS] for row in rows],
        decimal=".",
        problems=source.problems,
    )
    own_columns = {"press": _PRESS, **({"indenter": _INDENTER} if data.indenters else {})}
    recorded = presses_of(
        table,
        data.model_copy(update={"columns": data.columns.model_copy(update=own_columns)}),
        image=lambda name, field: partial(_image, source, name, field, data),
        at_rest=lambda name, field: _at_rest(source, name, field, data),
    )
    left_out = len(names) - len(rows)
    note = f"{left_out} records were left out: the indenter went aside or turned in them."
    return replace(recorded, notes=(*recorded.notes, note)) if left_out else recorded


def _names(source: Source, data: RecordsData) -> list[str]:
    """Return the records' files; an ``.npy`` beside an ``.npz`` of its name is its origin."""
    inside = source.prefix(data.records, field="data.records")
    there = {
        path.name
        for path in (source.root / inside).iterdir()
        if path.suffix in (NPY, NPZ) and path.name.startswith(data.starts)
        if not path.name.startswith(".")
    }
    there -= {f"{PurePath(name).stem}{NPY}" for name in there if name.endswith(NPZ)}
    kept = [name for name in sorted(there) if f"{inside}{name}" != data.no_contact]
    if not 0 < len(kept) <= RECORDS_MOST:
        raise RecordError(
            f"data.records: {data.records!r} has {len(kept)} files {NPY} or {NPZ}; 1 to "
            f"{RECORDS_MOST} are read",
            remedy="name the folder that the records are in, or some of them by data.starts",
        )
    return [f"{inside}{name}" for name in kept]


def _read(source: Source, name: str) -> Record:
    """Return a record's arrays by name."""
    data = source.read(name, field="a record", most_bytes=RECORD_BYTES)
    if name.endswith(NPZ):
        return read_npz(data, array_names(data, name=name), name=name)
    try:
        found = read_npy(data, name=name)
    except RecordError as error:
        if "pickle" not in error.message:
            raise
        raise RecordError(
            error.message,
            remedy="if you trust who made it, save its arrays by name with numpy.savez: "
            "docs/reference/file-formats.md has the lines",
        ) from error
    if found.dtype.names is None or found.size != 1:
        raise RecordError(
            f"{name}: holds {list(found.shape)} of {found.dtype}, no record with named fields",
            remedy="docs/reference/file-formats.md shows how a record is saved with numpy.savez",
        )
    return {key: found.reshape(())[key] for key in found.dtype.names}


def _rows(record: Record, name: str, data: RecordsData) -> list[dict[str, str]]:
    """Return a record's numbers and words as cells of a row; none if it does not press straight."""
    keys = f"its keys: {', '.join(list(record)[:40])[:300] or 'none'}"
    cells = {key: _cell(each) for key, each in record.items() if each.size == 1}
    for key in data.still:
        if not cells.get(key):
            raise RecordError(f"data.still: {name} has no number {key!r}", remedy=keys)
        if float(cells[key]) != 0.0:
            return []
    image = data.columns.image or ""
    wanted = [each.column for _, each in data.columns if isinstance(each, Column)]
    if missing := [key for key in (*wanted, image) if key not in record]:
        raise RecordError(f"data.columns: {name} has no {missing[0]!r}", remedy=keys)
    terms = [term for part, term in data.indenters.items() if part in PurePath(name).stem]
    if data.indenters and len(terms) != 1:
        raise RecordError(
            f"data.indenters: {len(terms)} of {', '.join(data.indenters)} are in the name {name}",
            remedy="write for each indenter a part of the records' names that no other has",
        )
    own = {_PRESS: PurePath(name).stem, image: name}
    return [{**cells, **own, **({_INDENTER: terms[0]} if terms else {})}]


def _cell(array: AnyArray) -> str:
    """Return a single number or word as text; nothing of other kinds."""
    value = array.reshape(-1)[0]
    if array.dtype.kind == "U":
        return str(value)
    return repr(float(value)) if array.dtype.kind in "fiu" else ""


def _image(source: Source, name: str, field: str, data: RecordsData) -> bytes:
    key = data.columns.image or ""
    return _png(_read(source, name)[key], f"{field}: {name}: {key}", data.colour_order)


def _at_rest(source: Source, name: str, field: str, data: RecordsData) -> Callable[[], bytes]:
    if not name.endswith(NPY):
        return image_files(source)(name, field)
    found = read_npy(source.read(name, field=field, most_bytes=RECORD_BYTES), name=name)
    return partial(_png, found, f"{field}: {name}", data.colour_order)


def _png(image: AnyArray, where: str, order: ColourOrder) -> bytes:
    """Return an image [height, width, 3] of 8 bits as PNG."""
    is_image = image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    if not is_image or not 0 < image.shape[0] * image.shape[1] <= IMAGE_PIXELS:
        raise RecordError(
            f"{where}: is {list(image.shape)} of {image.dtype}; images are [height, width, 3] of "
            "uint8",
            remedy="name the key of the image as data.columns.image",
        )
    return encode_png(np.ascontiguousarray(image[..., ::-1] if order is ColourOrder.BGR else image))
