"""Rows of a table as presses, and the images that they name."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing.presses import (
    ORDER_NS,
    Frame,
    Press,
    Recorded,
    Samples,
    Window,
)
from tacauchy_rig.app.importing.source import IMAGE_BYTES, Source
from tacauchy_rig.app.importing.table import Column, Dialect, Table, read_table
from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.config.fields import Force, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import Dimension
from tacauchy_rig.core.run import FZ

Image = Callable[[str, str], Callable[[], bytes]]
"""Returns what reads an image, from its name and the field that names it; whether it is there is
asked at once."""

WRENCH = ("force_x", "force_y", "force", "moment_x", "moment_y", "moment_z")
POSE = ("x", "y", "z")
_DIMENSIONS = {"force": Dimension.FORCE, "moment": Dimension.TORQUE, "time": Dimension.TIME}
"""By the first word of a column's name; all others are lengths."""


class SampleColumns(Section):
    """Which columns hold forces, moments and the tip's position, and in which unit.

    Attributes:
        force: Along the sensor's axis; the others of the wrench as they are known.
        x: Of the tip relative to the pad's centre.
        z: Of the tip, upwards.
    """

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
    """Which column holds what.

    Attributes:
        image: File of the row's image, within ``images``; left out, there are no images.
        press: Name of the press that a row belongs to; without, each row is a press.
        state: Whether a row is unloaded or pressed; anything else is neither. Without, every row
            is pressed.
        depth: Below first touch.
        indenter: As ``press --indenter`` has it, or a key of ``data.indenters``.
    """

    image: str | None = None
    press: str | None = None
    state: str | None = None
    indenter: str | None = None
    time: Column | None = None
    depth: Column | None = None
    contact_z: Column | None = None


class RowsData(Dialect):
    """``[data]`` of every kind of table.

    Attributes:
        no_contact: Image of the gel at rest, for presses without an unloaded row.
        is_tared: Forces are zero without contact: unloaded rows define no zero.
        contact_force: At which depth counts from; left out, depth counts from first touch.
        unloaded: What the state of a row at rest says.
        pressed: What that of a row pressed says.
        indenters: Terms as ``press --indenter`` has them, by what the column of indenters says.
    """

    columns: Columns
    no_contact: str | None = None
    is_tared: bool = False
    contact_force: Force | None = None
    unloaded: str = "unloaded"
    pressed: str = "pressed"
    indenters: dict[str, str] = Field(default_factory=dict)


class CsvData(RowsData):
    """``[data]`` of a folder with a CSV.

    Attributes:
        table: The CSV.
        images: Folder of the images.
    """

    table: str = "presses.csv"
    images: str = "."


def read_csv_folder(source: Source, data: CsvData) -> Recorded:
    """Read a folder of images with a CSV; what is odd in it is noted with line and column.

    Raises:
        RecordError: The table cannot be read, or its times tell rest and press apart nowhere.
    """
    table = read_table(source, data.table, field="data.table", dialect=data)
    images = source.folder(data.images, field="data.images").relative_to(source.root)
    prefix = "" if str(images) == "." else f"{images}/"
    return presses_of(table, data, image=image_files(source, prefix), at_rest=image_files(source))


def image_files(source: Source, prefix: str = "") -> Image:
    """Return what finds images that are files, below a folder."""

    def image(name: str, field: str) -> Callable[[], bytes]:
        source.path(prefix + name, field=field, most_bytes=IMAGE_BYTES)
        return partial(source.read, prefix + name, field=field, most_bytes=IMAGE_BYTES)

    return image


def presses_of(table: Table, data: RowsData, *, image: Image, at_rest: Image) -> Recorded:
    """Return the presses that a table's rows hold, as far as its cells can be read.

    Args:
        image: Of a row.
        at_rest: Of ``no_contact``.
    """
    rows = _Rows(table, data)
    problems, presses = table.problems, []
    rest = None
    if data.no_contact is not None:
        with problems.noting():
            rest = at_rest(data.no_contact, "data.no_contact")
    for name in dict.fromkeys(rows.press.tolist()):
        with problems.noting():
            own = np.flatnonzero(rows.press == name)
            presses.append(_press(data, rows, own, image=image, rest=rest))
    return Recorded(
        presses=tuple(presses),
        has_clock=rows.has_clock,
        contact_force_n=data.contact_force,
        unknown=tuple(_unknown(data.columns, data)),
        notes=tuple(rows.notes),
    )


def _unknown(columns: Columns, data: RowsData) -> list[str]:
    has_zero = columns.force is None or data.is_tared or columns.state is not None
    lacks = {
        "What ties force and image of a row together in time": True,
        "The force": columns.force is None,
        "The zero of the force cell": not has_zero,
        "The depth": columns.depth is None and columns.z is None,
        "Where on the pad was pressed": columns.x is None or columns.y is None,
        "How the indenter leans": columns.moment_x is None,
    }
    return [f"{what} is not known." for what, is_lacking in lacks.items() if is_lacking]


class _Rows:
    """A table as arrays of one length."""

    def __init__(self, table: Table, data: RowsData) -> None:
        columns, count = data.columns, len(table.rows)

        def text(column: str | None, name: str, otherwise: list[str]) -> np.ndarray:
            cells = table.text(column, field=f"data.columns.{name}") if column else otherwise
            return np.array(cells, dtype=object)

        self.table = table
        self.notes = ["Stamps of this run count rows; no time was stated."]
        self.has_clock = columns.time is not None
        self.press = text(columns.press, "press", [str(k) for k in range(1, count + 1)])
        self.state = text(columns.state, "state", [data.pressed] * count)
        self.image = text(columns.image, "image", [""] * count)
        self.indenter = text(columns.indenter, "indenter", [""] * count)
        self.wrench = read_columns(table, columns, *WRENCH)
        self.place = read_columns(table, columns, *POSE)
        self.depth, self.contact_z = read_columns(table, columns, "depth", "contact_z").T
        self.stamp_ns: Int64Array = ORDER_NS * np.arange(1, count + 1)
        if columns.time is not None:
            self._take_times(read_columns(table, columns, "time")[:, 0], columns.time, data)

    def _take_times(self, time_s: FloatArray, column: Column, data: RowsData) -> None:
        """Take times as stamps that begin a second after zero, unless labels contradict them."""
        missing = np.flatnonzero(np.isnan(time_s)).tolist()
        if missing:
            self.table.problems.add(
                f"{self.table.where(missing[0], column.column)}: has no time; "
                f"{len(missing)} rows have none",
                remedy="every row needs one, or leave data.columns.time out",
            )
            return
        stamps = np.asarray(np.rint((time_s - time_s.min() + 1.0) * 1e9), dtype=np.int64)
        self.notes = list(_told_times(stamps, self.press, column.column))
        contradicted = self._contradicted(stamps, data)
        if contradicted is None:
            self.stamp_ns = stamps
            return
        self.has_clock = False
        self.notes.append(
            f'Times of the column "{column.column}" were left out: those of press '
            f"{self.press[contradicted]} do not tell its rows at rest from its rows pressed "
            f"({self.table.where(contradicted)}), which are labelled. Stamps of this run count "
            "rows."
        )

    def _contradicted(self, stamps: Int64Array, data: RowsData) -> int | None:
        """Return a row at rest that its stamp puts among the rows pressed; None where none is."""
        for name in dict.fromkeys(self.press.tolist()):
            own = np.flatnonzero(self.press == name)
            rest, held = own[self.state[own] == data.unloaded], own[self.state[own] == data.pressed]
            if not len(held):
                continue
            first, last = stamps[held].min(), stamps[held].max()
            inside = rest[(stamps[rest] >= first) & (stamps[rest] <= last)]
            if len(inside):
                return int(inside[0])
        return None

    def window(self, own: np.ndarray) -> Window | None:
        """Return first and last stamp of some rows; None of none."""
        stamps = self.stamp_ns[own]
        return (int(stamps.min()), int(stamps.max())) if len(own) else None

    def samples(self, own: np.ndarray, values: FloatArray) -> Samples | None:
        """Return the values of some rows as a stream; None of none."""
        return Samples(stamp_ns=self.stamp_ns[own], value=values[own]) if len(own) else None


def _told_times(stamps: Int64Array, press: np.ndarray, column: str) -> list[str]:
    """Return what is odd about the order of times within presses."""
    step = np.diff(stamps)[press[1:] == press[:-1]]
    back, still = int((step < 0).sum()), int((step == 0).sum())
    told = [f'Times of the column "{column}" go back {back} times; rows were sorted by them.']
    alike = f'{still} rows have the time of the row before (column "{column}").'
    return told * bool(back) + [alike] * bool(still)


def _at_one_side(rows: _Rows, rest: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return the rows at rest before a press; those after it, where none are before.

    Raises:
        RecordError: Some lie between rows pressed: these are several presses.
    """
    stamps, first, last = rows.stamp_ns, rows.stamp_ns[held].min(), rows.stamp_ns[held].max()
    between = rest[(stamps[rest] > first) & (stamps[rest] < last)]
    if len(between):
        raise RecordError(
            f"{rows.table.where(int(between[0]))}: press {rows.press[held[0]]} is at rest between "
            "rows in which it is pressed",
            remedy="give each press a name of its own in the column of data.columns.press",
        )
    before = rest[stamps[rest] < first]
    return before if len(before) else rest


def _press(
    data: RowsData,
    rows: _Rows,
    own: np.ndarray,
    *,
    image: Image,
    rest: Callable[[], bytes] | None,
) -> Press:
    name, table = rows.press[own[0]], rows.table
    own = own[np.argsort(rows.stamp_ns[own], kind="stable")]
    unloaded, pressed = own[rows.state[own] == data.unloaded], own[rows.state[own] == data.pressed]
    if not len(pressed):
        raise RecordError(
            f'{table.name}: press {name} has no row whose state is "{data.pressed}"',
            remedy="say what the column of data.columns.state says: data.unloaded, data.pressed",
        )
    frames = _frames(rows, own, image, data)
    reference = rows.window(_at_one_side(rows, unloaded[rows.image[unloaded] != ""], pressed))
    if reference is None and data.no_contact is not None and frames:
        stamp = int(rows.stamp_ns[own[0]]) - ORDER_NS
        if rest is not None:
            frames.insert(0, Frame(stamp_ns=stamp, name=data.no_contact, read=rest))
        reference = (stamp, stamp)
    if reference is None and frames:
        raise RecordError(
            f"{table.name}: press {name} has no image of the gel at rest",
            remedy=f'name one as data.no_contact, or add rows whose state is "{data.unloaded}"',
        )
    has_force: BoolArray = np.asarray(~np.isnan(rows.wrench[:, FZ]))
    has_place: BoolArray = np.asarray(~np.isnan(rows.place).any(axis=1))
    pose = np.pad(rows.place, ((0, 0), (0, 3)), constant_values=math.nan)
    x, y, _ = _mean(rows.place[pressed])
    dwell = rows.window(pressed) or (0, 0)
    term, term_at = _indenter(data, rows, pressed)
    return Press(
        name=name,
        frames=tuple(frames),
        reference=reference or dwell,
        dwell=dwell,
        force=rows.samples(own[has_force[own]], rows.wrench),
        pose=rows.samples(own[has_place[own]], pose),
        tare=None
        if data.is_tared
        else rows.window(_at_one_side(rows, unloaded[has_force[unloaded]], pressed)),
        contact_z_m=_known(_mean(rows.contact_z[own])),
        depth_m=_known(_mean(rows.depth[pressed])),
        place_m=None if math.isnan(x) or math.isnan(y) else (float(x), float(y)),
        indenter=term,
        where=table.where(int(pressed[0])),
        indenter_at=term_at,
    )


def _frames(rows: _Rows, own: np.ndarray, image: Image, data: RowsData) -> list[Frame]:
    """Return the images of rows; those that are not there are noted."""
    frames = []
    for k in own.tolist():
        if rows.image[k]:
            where = rows.table.where(k, data.columns.image or "")
            with rows.table.problems.noting():
                read = image(rows.image[k], where)
                frames.append(Frame(stamp_ns=int(rows.stamp_ns[k]), name=rows.image[k], read=read))
    return frames


def _indenter(data: RowsData, rows: _Rows, pressed: np.ndarray) -> tuple[str, str]:
    """Return a press's indenter and where it stands."""
    for k in pressed.tolist():
        if cell := rows.indenter[k]:
            return data.indenters.get(cell, cell), rows.table.where(k, data.columns.indenter or "")
    return "", ""


def _known(value: FloatArray) -> float | None:
    return None if math.isnan(value) else float(value)


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean over rows of what is known; NaN where nothing is."""
    known = ~np.isnan(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.asarray(np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan))
