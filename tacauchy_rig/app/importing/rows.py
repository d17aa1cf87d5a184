"""Rows of a table as presses: a row holds an image, a force, a depth, or some of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tacauchy_rig.app.importing.press import ORDER_NS, Frame, Press, Recorded, Samples, Window
from tacauchy_rig.app.importing.spec import Column
from tacauchy_rig.app.importing.table import Table
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.fields import Force, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import Dimension

Image = Callable[[str, str], Callable[[], bytes]]
"""Returns what reads an image, from its name and the field that names it; whether it is there is
asked at once."""

UNLOADED, PRESSED = "unloaded", "pressed"
_WRENCH = ("force_x", "force_y", "force", "moment_x", "moment_y", "moment_z")
_POSE = ("x", "y", "z")


class Columns(Section):
    """Which column says what; those with numbers say in which unit.

    Attributes:
        image: File of the row's image, within ``images``.
        press: Name of the press that a row belongs to; without, each row is a press.
        state: ``unloaded`` or ``pressed``; anything else is neither. Without, every row is pressed.
        force: Along the sensor's axis; the others of the wrench as they are known.
        depth: Below first touch.
        x: Of the tip beside the pad's centre.
        z: Of the tip, upwards.
        indenter: As ``press --indenter`` has it.
    """

    image: str
    press: str | None = None
    state: str | None = None
    indenter: str | None = None
    time: Column | None = None
    force: Column | None = None
    force_x: Column | None = None
    force_y: Column | None = None
    moment_x: Column | None = None
    moment_y: Column | None = None
    moment_z: Column | None = None
    depth: Column | None = None
    x: Column | None = None
    y: Column | None = None
    z: Column | None = None
    contact_z: Column | None = None


class RowsData(Section):
    """What ``[data]`` of every kind of table says.

    Attributes:
        no_contact: Image of the gel at rest, for presses without an unloaded row.
        is_tared: Forces are zero without contact: unloaded rows tell no zero.
        contact_force: At which depth counts from; left out, depth counts from first touch.
    """

    columns: Columns
    no_contact: str | None = None
    is_tared: bool = False
    contact_force: Force | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """The table as columns of one length."""

    press: Sequence[str]
    state: Sequence[str]
    image: Sequence[str]
    indenter: Sequence[str]
    stamp_ns: np.ndarray
    wrench: FloatArray
    place: FloatArray
    depth: FloatArray
    contact_z: FloatArray


def presses_of(table: Table, data: RowsData, *, image: Image, at_rest: Image) -> Recorded:
    """Return the presses that a table's rows tell.

    Args:
        image: Of a row.
        at_rest: Of ``no_contact``.

    Raises:
        RecordError: A row is odd; names it with line and column.
        ConfigError: A unit is not of what it is to measure.
    """
    columns, rows = data.columns, _rows(table, data.columns)
    presses = tuple(
        _press(
            table.name,
            data,
            rows,
            np.flatnonzero(np.array(rows.press) == name),
            image=image,
            at_rest=at_rest,
        )
        for name in dict.fromkeys(rows.press)
    )
    return Recorded(
        presses=presses,
        has_clock=columns.time is not None,
        contact_force_n=data.contact_force,
        unknown=tuple(_unknown(columns, data)),
        notes=() if columns.time else ("Stamps of this run count rows; no time was stated.",),
    )


def _unknown(columns: Columns, data: RowsData) -> list[str]:
    lacks = {
        "What ties force and image of a row together in time": True,
        "The force": columns.force is None,
        "The zero of the force cell": columns.force is not None
        and not data.is_tared
        and columns.state is None,
        "The depth": columns.depth is None and columns.z is None,
        "Where on the pad was pressed": columns.x is None or columns.y is None,
        "How the indenter leans": columns.moment_x is None,
    }
    return [f"{what} is not known." for what, is_lacking in lacks.items() if is_lacking]


def _rows(table: Table, columns: Columns) -> _Rows:
    def text(name: str, otherwise: list[str]) -> list[str]:
        column = getattr(columns, name)
        return otherwise if column is None else table.text(column, field=f"data.columns.{name}")

    def numbers(name: str, dimension: Dimension) -> FloatArray:
        field = f"data.columns.{name}"
        return np.array(table.numbers(getattr(columns, name), dimension, field=field))

    count = len(table.rows)
    force, moment = Dimension.FORCE, Dimension.TORQUE
    stamps = ORDER_NS * np.arange(1, count + 1)
    if columns.time is not None:
        stamps = _stamps(numbers("time", Dimension.TIME), table.name)
    return _Rows(
        press=text("press", [str(k) for k in range(1, count + 1)]),
        state=text("state", [PRESSED] * count),
        image=text("image", [""] * count),
        indenter=text("indenter", [""] * count),
        stamp_ns=stamps,
        wrench=np.stack([numbers(n, moment if "moment" in n else force) for n in _WRENCH], axis=1),
        place=np.stack([numbers(name, Dimension.LENGTH) for name in _POSE], axis=1),
        depth=numbers("depth", Dimension.LENGTH),
        contact_z=numbers("contact_z", Dimension.LENGTH),
    )


def _stamps(time_s: FloatArray, name: str) -> np.ndarray:
    """Return times as stamps that begin a second after zero."""
    if np.isnan(time_s).any():
        line = int(np.flatnonzero(np.isnan(time_s))[0]) + 2
        raise RecordError(f"{name} line {line}: has no time", remedy="every row needs one")
    return np.asarray(np.rint((time_s - time_s.min() + 1.0) * 1e9), dtype=np.int64)


def _press(
    table: str, data: RowsData, rows: _Rows, own: np.ndarray, *, image: Image, at_rest: Image
) -> Press:
    name = rows.press[own[0]]
    own = own[np.argsort(rows.stamp_ns[own], kind="stable")]
    unloaded = np.array([k for k in own if rows.state[k] == UNLOADED], dtype=int)
    pressed = np.array([k for k in own if rows.state[k] == PRESSED], dtype=int)
    if not len(pressed):
        raise RecordError(
            f'{table}: press {name} has no row whose state is "{PRESSED}"',
            remedy=f'write "{UNLOADED}" and "{PRESSED}" into the column of data.columns.state',
        )
    frames = [
        Frame(
            stamp_ns=int(rows.stamp_ns[k]),
            name=rows.image[k],
            read=image(rows.image[k], f"press {name}, image"),
        )
        for k in own
        if rows.image[k]
    ]
    reference = _window(rows, [k for k in unloaded if rows.image[k]])
    if reference is None and data.no_contact is not None:
        stamp = int(rows.stamp_ns[own[0]]) - ORDER_NS
        rest = at_rest(data.no_contact, "data.no_contact")
        frames.insert(0, Frame(stamp_ns=stamp, name=data.no_contact, read=rest))
        reference = (stamp, stamp)
    if reference is None:
        raise RecordError(
            f"{table}: press {name} has no image of the gel at rest",
            remedy=f'name one as data.no_contact, or add rows whose state is "{UNLOADED}"',
        )
    felt = own[~np.isnan(rows.wrench[own, 2])]
    zero = [k for k in unloaded if k in felt]
    x, y, _ = _mean(rows.place[pressed])
    depth = float(_mean(rows.depth[pressed]))
    z = own[~np.isnan(rows.place[own]).any(axis=1)]
    contact_z = float(_mean(rows.contact_z[own]))
    return Press(
        name=name,
        frames=tuple(frames),
        reference=reference,
        dwell=_window(rows, pressed) or (0, 0),
        force=_samples(rows, felt, rows.wrench),
        pose=None
        if not len(z)
        else _samples(rows, z, np.pad(rows.place, ((0, 0), (0, 3)), constant_values=math.nan)),
        tare=None if data.is_tared else _window(rows, zero),
        contact_z_m=None if math.isnan(contact_z) else contact_z,
        depth_m=None if math.isnan(depth) else depth,
        place_m=None if math.isnan(x) or math.isnan(y) else (float(x), float(y)),
        indenter=next((rows.indenter[k] for k in pressed if rows.indenter[k]), ""),
    )


def _window(rows: _Rows, own: Sequence[int] | np.ndarray) -> Window | None:
    stamps = [int(rows.stamp_ns[k]) for k in own]
    return (min(stamps), max(stamps)) if stamps else None


def _samples(rows: _Rows, own: np.ndarray, values: FloatArray) -> Samples | None:
    return Samples(stamp_ns=rows.stamp_ns[own], value=values[own]) if len(own) else None


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean over rows of what is known; NaN where nothing is."""
    known = ~np.isnan(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.asarray(np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan))
