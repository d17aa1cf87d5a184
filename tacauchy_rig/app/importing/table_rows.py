"""Rows of a table as presses with the images that they name: of a CSV, or of NumPy's records.

A record is a press: ``.npz`` of arrays by name, or a structured ``.npy``. FEATS' records hold so an
image, the indenter's place and way, and the cell's forces (Helmut et al., arXiv 2411.03315). As
they are published they are pickles, which are never loaded.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path, PurePath

import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing import source_files
from tacauchy_rig.app.importing.press_detection import (
    ORDER_NS,
    Frame,
    Press,
    Recorded,
    Samples,
    Window,
)
from tacauchy_rig.app.importing.text_tables import Column, Dialect, Table, read_table
from tacauchy_rig.core.arrays import AnyArray, FloatArray, IndexArray, Int64Array
from tacauchy_rig.core.config.field_ranges import Force, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import ColourOrder, encode_png
from tacauchy_rig.core.quantities import Dimension
from tacauchy_rig.core.run import FZ

Image = Callable[[str, str], Callable[[], bytes]]
"""Returns what reads an image, from its name and the field that names it; whether it is there is
asked at once."""

WRENCH = ("force_x", "force_y", "force", "moment_x", "moment_y", "moment_z")
POSE = ("x", "y", "z")
_DIMENSIONS = {"force": Dimension.FORCE, "moment": Dimension.TORQUE, "time": Dimension.TIME}
"""By the first word of a column's name; all others are lengths."""
SLOW_S = 600.0
"""Of a press by its times: a press of a second has it if its milliseconds are read as seconds."""
MOVED = 0.1
"""Of a press's force that forces at rest may differ by from its rest to the next press's."""


class SampleColumns(Section):
    """Which columns hold the wrench (``force`` along the sensor's axis) and the tip's position."""

    force: Column | None = None
    force_x: Column | None = None
    force_y: Column | None = None
    moment_x: Column | None = None
    moment_y: Column | None = None
    moment_z: Column | None = None
    x: Column | None = None
    y: Column | None = None
    z: Column | None = None


def read_columns(table: Table, columns: SampleColumns, *names: str) -> FloatArray:
    """Return columns by their role in SI, shape [n, names]; NaN where nothing is known."""
    values = [
        table.numbers(
            getattr(columns, name),
            _DIMENSIONS.get(name.partition("_")[0], Dimension.LENGTH),
            field=f"data.columns.{name}",
        )
        for name in names
    ]
    return np.array(values).T


class Columns(SampleColumns):
    """Which column holds what: of words by its name, of numbers with their unit."""

    image: str | None = None
    press: str | None = None
    state: str | None = None
    indenter: str | None = None
    time: Column | None = None
    depth: Column | None = None
    contact_z: Column | None = None


class RowsData(Dialect):
    """``[data]`` of every kind of table."""

    columns: Columns
    no_contact: str | None = None
    is_tared: bool = False
    contact_force: Force | None = None
    unloaded: str = "unloaded"
    pressed: str = "pressed"
    indenters: dict[str, str] = Field(default_factory=dict)


class CsvData(RowsData):
    """``[data]`` of a folder with a CSV."""

    table: str = "presses.csv"
    images: str = "."


def read_csv_folder(source: source_files.Source, data: CsvData) -> Recorded:
    """Read a folder of images with a CSV; what is odd in it is noted with line and column.

    Raises:
        RecordError: The table cannot be read, or its times tell rest and press apart nowhere.
    """
    table = read_table(source, data.table, field="data.table", dialect=data)
    prefix = source.prefix(data.images, field="data.images")
    source.notes += _unnamed(table, data, source.root / prefix)
    return presses_of(table, data, image=image_files(source, prefix), at_rest=image_files(source))


def _unnamed(table: Table, data: CsvData, folder: Path) -> Iterator[str]:
    """Yield images that are called as those of the table but for their numbers, and in no row."""
    column = data.columns.image
    if column is None or column not in table.columns:
        return
    named = set(table.cells(column)) | {data.no_contact}
    kinds = {re.sub(r"\d+", "0", name) for name in table.cells(column) if re.search(r"\d", name)}
    there = sorted(path.name for path in folder.iterdir())
    if others := [n for n in there if n not in named and re.sub(r"\d+", "0", n) in kinds]:
        yield (
            f"{len(others)} images are in no row of {table.name}, the first {others[0]}: if rows "
            "were lost, give the whole table (data.table)."
        )


def image_files(source: source_files.Source, prefix: str = "") -> Image:
    """Return what finds images that are files, below a folder."""

    def image(name: str, field: str) -> Callable[[], bytes]:
        source.path(prefix + name, field=field, most_bytes=source_files.IMAGE_BYTES)
        return partial(source.read, prefix + name, field=field, most_bytes=source_files.IMAGE_BYTES)

    return image


def read_times(table: Table, columns: SampleColumns, name: str) -> FloatArray | None:
    """Return the times of all rows [s]; None, and a problem is noted, where they cannot be."""
    time_s = read_columns(table, columns, "time")[:, 0]
    missing = np.flatnonzero(np.isnan(time_s)).tolist()
    years = float(np.ptp(time_s)) / 31_557_600.0
    if missing:
        table.problems.add(
            f"{table.where(missing[0], name)}: has no time; {len(missing)} rows have none",
            remedy='every row needs one; only kind = "csv" can do without data.columns.time',
        )
    elif years > 10.0:
        table.problems.add(
            f'{table.name}, column "{name}": its times span {years:.3g} years',
            remedy="correct the unit of times (data.columns.time.unit): the numbers look like ns "
            "where s is stated",
        )
    else:
        return time_s
    return None


def presses_of(table: Table, data: RowsData, *, image: Image, at_rest: Image) -> Recorded:
    """Return the presses that a table's rows hold, as far as its cells can be read.

    Args:
        image: Of a row.
        at_rest: Of ``no_contact``.
    """
    rows = _Rows(table, data)
    problems, presses, rest = table.problems, [], None
    if data.no_contact is not None:
        with problems.noting():
            rest = at_rest(data.no_contact, "data.no_contact")
    for own in rows.by_press():
        with problems.noting():
            presses.append(rows.press_of(own, image, rest))
    columns = data.columns
    has_zero = columns.force is None or data.is_tared or columns.state is not None
    unknown = ["The delay between force and image of a row is not known."]
    unknown += ["The zero of the force cell is not known."] * (not has_zero)
    unknown += ["The tilt of the indenter is not known."] * (columns.moment_x is None)
    return Recorded(
        presses=tuple(presses),
        has_clock=rows.has_clock,
        contact_force_n=data.contact_force,
        unknown=tuple(unknown),
        notes=tuple(rows.notes),
    )


class _Rows:
    """A table as arrays of one length."""

    def __init__(self, table: Table, data: RowsData) -> None:
        columns, count = data.columns, len(table.rows)

        def text(name: str, otherwise: list[str]) -> AnyArray:
            column = getattr(columns, name)
            cells = table.text(column, field=f"data.columns.{name}") if column else otherwise
            return np.array(cells, dtype=object)

        self.table, self.data = table, data
        self.press = text("press", [str(k) for k in range(1, count + 1)])
        state = text("state", [data.pressed] * count)
        self.at_rest, self.pressed = state == data.unloaded, state == data.pressed
        self.image = text("image", [""] * count)
        self.indenter = text("indenter", [""] * count)
        self.wrench = read_columns(table, columns, *WRENCH)
        place = read_columns(table, columns, *POSE)
        self.pose = np.pad(place, ((0, 0), (0, 3)), constant_values=math.nan)
        self.depth, self.contact_z = read_columns(table, columns, "depth", "contact_z").T
        self.notes = ["No times were stated: the stamps of this run count rows."]
        self.has_clock = columns.time is not None
        self.stamp_ns: Int64Array = ORDER_NS * np.arange(1, count + 1)
        if columns.time is not None:
            self._take_times(columns.time.column)
        self.notes += [*self._without_force(), *self._slow(), *self._moved()]

    def _without_force(self) -> Iterator[str]:
        """Yield how many rows state that their force is no number; empty cells state nothing."""
        column = self.data.columns.force
        if column is None or column.column not in self.table.columns:
            return
        cells, lost = self.table.cells(column.column), np.isnan(self.wrench[:, FZ])
        if told := [k for k in np.flatnonzero(lost).tolist() if cells[k]]:
            yield (
                f"{self.table.where(told[0], column.column)}: {cells[told[0]]!r} is no force; "
                f"{len(told)} of {len(cells)} rows were left out of zeros and forces: correct "
                "these cells, or leave them empty."
            )

    def _slow(self) -> Iterator[str]:
        """Yield the press that takes longest, where it takes too long for its unit of time."""
        column = self.data.columns.time
        if column is None or not self.has_clock:
            return
        spans_s = [float(np.ptp(self.stamp_ns[own])) / 1e9 for own in self.by_press()]
        if (longest_s := max(spans_s)) > SLOW_S:
            name = list(dict.fromkeys(self.press.tolist()))[spans_s.index(longest_s)]
            yield (
                f'Press {name} takes {longest_s:.4g} s by the column "{column.column}" in '
                f"{column.unit}: if it took a thousandth of that, correct data.columns.time.unit."
            )

    def _moved(self) -> Iterator[str]:
        """Yield where the force at rest moves most from a press's rest to that of the next."""
        force, zeros = self.wrench[:, FZ], list[tuple[float, float, int]]()
        for own in self.by_press():
            zero, held = (_mean(force[own[there[own]]]) for there in (self.at_rest, self.pressed))
            if zero is not None and held is not None:
                zeros.append((zero, abs(held - zero), int(own[0])))
        moved = [
            (abs(after[0] - before[0]) / before[1], abs(after[0] - before[0]), after[2])
            for before, after in pairwise(zeros)
            if before[1] > 0.0
        ]
        share, step_n, row = max(moved, default=(0.0, 0.0, 0))
        if share > MOVED:
            yield (
                f"{self.table.where(row)}: the force at rest moves by {step_n:.3g} N from the "
                f"press before, {share:.0%} of that press's force: a press may be off by as much. "
                "Let the cell warm up, or record rest right before each press."
            )

    def by_press(self) -> list[IndexArray]:
        """Return the rows of each press."""
        return [np.flatnonzero(self.press == name) for name in dict.fromkeys(self.press.tolist())]

    def _take_times(self, column: str) -> None:
        """Take times as stamps that begin a second after zero, unless labels contradict them."""
        time_s = read_times(self.table, self.data.columns, column)
        if time_s is None:
            return
        stamps = np.asarray(np.rint((time_s - time_s.min() + 1.0) * 1e9), dtype=np.int64)
        step = np.diff(stamps)[self.press[1:] == self.press[:-1]]
        back, still = int((step < 0).sum()), int((step == 0).sum())
        told = f'Times of the column "{column}" go back {back} times; rows were sorted by them.'
        alike = f'{still} rows have the time of the row before (column "{column}").'
        self.notes = [told] * bool(back) + [alike] * bool(still)
        contradicted = [k for own in self.by_press() for k in self._between(own, stamps).tolist()]
        if not contradicted:
            self.stamp_ns = stamps
            return
        self.has_clock = False
        self.notes.append(
            f'Times of the column "{column}" were left out: those of press '
            f"{self.press[contradicted[0]]} do not tell its rows at rest from its rows pressed "
            f"({self.table.where(contradicted[0])}), which are labelled. Stamps of this run count "
            "rows."
        )

    def _between(self, own: IndexArray, stamps: Int64Array) -> IndexArray:
        """Return a press's rows at rest that stamps put between its rows pressed."""
        rest, held = own[self.at_rest[own]], stamps[own[self.pressed[own]]]
        first, last = (held.min(), held.max()) if len(held) else (1, 0)
        return np.asarray(rest[(stamps[rest] >= first) & (stamps[rest] <= last)])

    def _window(self, own: IndexArray) -> Window | None:
        """Return first and last stamp of some rows; None of none."""
        stamps = self.stamp_ns[own]
        return (int(stamps.min()), int(stamps.max())) if len(own) else None

    def _rest_window(self, rest: IndexArray, pressed: IndexArray) -> Window | None:
        """Return when rows at rest were before a press, or after it, where none are before."""
        before = rest[self.stamp_ns[rest] < self.stamp_ns[pressed].min()]
        return self._window(before if len(before) else rest)

    def _samples(self, own: IndexArray, values: FloatArray) -> Samples | None:
        """Return the rows whose third number is known as a stream; None of none."""
        kept = own[~np.isnan(values[own, FZ])]
        return Samples(stamp_ns=self.stamp_ns[kept], value=values[kept]) if len(kept) else None

    def press_of(
        self, own: IndexArray, image: Image, no_contact: Callable[[], bytes] | None
    ) -> Press:
        """Return the press that some rows hold; raises a RecordError where it lacks something."""
        name, table, data = self.press[own[0]], self.table, self.data
        own = own[np.argsort(self.stamp_ns[own], kind="stable")]
        unloaded, pressed = own[self.at_rest[own]], own[self.pressed[own]]
        if not len(pressed):
            raise RecordError(
                f'{table.name}: press {name} has no row whose state is "{data.pressed}"',
                remedy="state the values of that column as data.unloaded and data.pressed",
            )
        if len(among := self._between(own, self.stamp_ns)):
            raise RecordError(
                f"{table.where(int(among[0]))}: press {name} is at rest between rows in which it "
                "is pressed",
                remedy="give each press a name of its own in the column of data.columns.press",
            )
        frames = self._frames(own, image)
        reference = self._rest_window(unloaded[self.image[unloaded] != ""], pressed)
        if reference is None and data.no_contact is not None and frames:
            stamp = int(self.stamp_ns[own[0]]) - ORDER_NS
            if no_contact is not None:
                frames.insert(0, Frame(stamp_ns=stamp, name=data.no_contact, read=no_contact))
            reference = (stamp, stamp)
        dwell = self._window(pressed) or (0, 0)
        weighed = unloaded[~np.isnan(self.wrench[unloaded, FZ])]
        x, y = (_mean(self.pose[pressed, axis]) for axis in (0, 1))
        named = next((k for k in pressed.tolist() if self.indenter[k]), None)
        term = "" if named is None else self.indenter[named]
        return Press(
            name=name,
            frames=tuple(frames),
            reference=reference or ((0, 0) if frames else dwell),  # stamps begin later
            dwell=dwell,
            force=self._samples(own, self.wrench),
            pose=self._samples(own, self.pose),
            tare=None if data.is_tared else self._rest_window(weighed, pressed),
            contact_z_m=_mean(self.contact_z[own]),
            depth_m=_mean(self.depth[pressed]),
            place_m=None if x is None or y is None else (x, y),
            indenter=data.indenters.get(term, term),
            where=table.where(int(pressed[0])),
            indenter_at="" if named is None else table.where(named, data.columns.indenter or ""),
        )

    def _frames(self, own: IndexArray, image: Image) -> list[Frame]:
        """Return the images of rows; those that are not there are noted."""
        frames = []
        for k in own.tolist():
            if name := self.image[k]:
                with self.table.problems.noting():
                    read = image(name, self.table.where(k, self.data.columns.image or ""))
                    frames.append(Frame(stamp_ns=int(self.stamp_ns[k]), name=name, read=read))
        return frames


def _mean(values: FloatArray) -> float | None:
    """Return the mean of what is known; None where nothing is."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else None


Record = Mapping[str, AnyArray]
NPY, NPZ = ".npy", ".npz"
RECORD_BYTES = 256 * source_files.MIB
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


def read_records(source: source_files.Source, data: RecordsData) -> Recorded:
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

    def at_rest(name: str, field: str) -> Callable[[], bytes]:
        if not name.endswith(NPY):
            return image_files(source)(name, field)
        found = source_files.read_npy(
            source.read(name, field=field, most_bytes=RECORD_BYTES), name=name
        )
        return partial(_png, found, f"{field}: {name}", data.colour_order)

    own_columns = {"press": _PRESS, **({"indenter": _INDENTER} if data.indenters else {})}
    recorded = presses_of(
        table,
        data.model_copy(update={"columns": data.columns.model_copy(update=own_columns)}),
        image=lambda name, field: partial(_image, source, name, field, data),
        at_rest=at_rest,
    )
    left_out = len(names) - len(rows)
    note = f"{left_out} records were left out: the indenter went aside or turned in them."
    return replace(recorded, notes=(*recorded.notes, note)) if left_out else recorded


def _names(source: source_files.Source, data: RecordsData) -> list[str]:
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


def _read(source: source_files.Source, name: str) -> Record:
    """Return a record's arrays by name."""
    data = source.read(name, field="a record", most_bytes=RECORD_BYTES)
    if name.endswith(NPZ):
        return source_files.read_npz(data, name=name)
    found = source_files.read_npy(data, name=name)
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


def _image(source: source_files.Source, name: str, field: str, data: RecordsData) -> bytes:
    key = data.columns.image or ""
    return _png(_read(source, name)[key], f"{field}: {name}: {key}", data.colour_order)


def _png(image: AnyArray, where: str, order: ColourOrder) -> bytes:
    """Return an image [height, width, 3] of 8 bits as PNG."""
    is_image = image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    if not is_image or not 0 < image.shape[0] * image.shape[1] <= source_files.IMAGE_PIXELS:
        raise RecordError(
            f"{where}: is {list(image.shape)} of {image.dtype}; images are [height, width, 3] of "
            "uint8",
            remedy="name the key of the image as data.columns.image",
        )
    return encode_png(np.ascontiguousarray(image[..., ::-1] if order is ColourOrder.BGR else image))
