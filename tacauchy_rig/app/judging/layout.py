"""The plain layout of a simulator's folder: ``simulator.toml`` and one folder a press.

Other people write it and ``judge`` reads it; docs/reference/file-formats.md describes it.
"""

from __future__ import annotations

import io
import json
import tomllib
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing.source import MIB, Source
from tacauchy_rig.app.importing.table import Column, read_section
from tacauchy_rig.core.config.fields import Section
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.rgb import ColourOrder, encode_png
from tacauchy_rig.core.simulated import Driven, Outputs, Simulator
from tacauchy_rig.core.store.durable import write_atomically

DESCRIPTION = "simulator.toml"
FORCES = "forces.csv"
IMAGE, HEIGHT, FIELDS = "image.png", "height.npy", "fields.npz"
PRESSURE, SHEAR = "pressure", ("shear_x", "shear_y")


class Signs(Section):
    """``[signs]``: -1 where numbers count the other way.

    Attributes:
        force: Positive in compression.
        depth: Positive into the gel.
        height: Negative where the gel is pressed in.
        pressure: Positive in compression.
    """

    force: Literal[1, -1] = 1
    depth: Literal[1, -1] = 1
    height: Literal[1, -1] = 1
    pressure: Literal[1, -1] = 1


class Units(Section):
    """``[units]``: of what stands in files without one.

    Attributes:
        force: Of ``forces.csv``; so is ``depth``.
        height: Of ``height.npy``.
        pressure: Of ``fields.npz``, shear too.
    """

    force: str | None = None
    depth: str | None = None
    height: str | None = None
    pressure: str | None = None

    def column(self, name: str, *, file: str, signs: Signs) -> Column:
        """Return a column of numbers with its unit and sign; ``name`` is a unit's here.

        Raises:
            ConfigError: The unit is not stated, or is of something else.
        """
        unit, dimension = getattr(self, name), DIMENSIONS[name]
        if unit is None:
            raise ConfigError(
                f"{DESCRIPTION}: units.{name} is not stated, and {file} has numbers of it",
                remedy=f"write {name} under [units]: one of {', '.join(UNITS[dimension])}",
            )
        column = Column(column=name, unit=unit, sign=getattr(signs, name))
        column.factor(dimension, field=f"{DESCRIPTION}: units.{name}")
        return column


DIMENSIONS = {
    "force": Dimension.FORCE,
    "depth": Dimension.LENGTH,
    "height": Dimension.LENGTH,
    "pressure": Dimension.PRESSURE,
}


class Description(Section):
    """All of ``simulator.toml``; the rest is as in ``Simulator``.

    Attributes:
        colour_order: Of ``image.png``; required if there is one.
        left_out: Presses that were not simulated, by their numbers.
    """

    name: str = Field(pattern=r"^[^\x00-\x1f<>]{1,60}$")
    version: str = Field(pattern=r"^[^\x00-\x1f<>]{1,40}$")
    colour_order: ColourOrder | None = None
    milliseconds_an_image: float | None = Field(default=None, gt=0.0, lt=1e9)
    machine: str = Field(default="", max_length=200)
    fitted_to_these: bool = False
    driven_by: Driven | None = None
    left_out: tuple[int, ...] = ()
    note: str = Field(default="", max_length=600)
    units: Units = Units()
    signs: Signs = Signs()

    @property
    def simulator(self) -> Simulator:
        """The simulator that it describes."""
        return Simulator(**{each.name: getattr(self, each.name) for each in fields(Simulator)})


def read_description(source: Source) -> Description:
    """Read the description of a folder.

    Raises:
        RecordError: It has no ``simulator.toml``.
        ConfigError: It is damaged, or has a value that is not allowed.
    """
    data = source.read(DESCRIPTION, field="the simulator's description", most_bytes=MIB)
    try:
        tables = tomllib.loads(data.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{source.root / DESCRIPTION}: no TOML: {error}",
            remedy="docs/reference/file-formats.md shows one",
        ) from error
    try:
        return read_section(Description, tables, where=f"{DESCRIPTION}: ")
    except ConfigError as error:
        raise ConfigError(
            error.message, remedy="docs/reference/file-formats.md shows one"
        ) from error


WRITTEN_UNITS = {"force": "N", "depth": "m", "height": "m", "pressure": "Pa"}


def check_empty(folder: Path) -> None:
    """Refuse a folder that holds something, before much is computed for it.

    Raises:
        RecordError: It does, or is none.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RecordError(
            f"{folder}: is not empty, and old presses must not mix with new ones",
            remedy="give --out another folder, or empty it",
        )


def write_outputs(folder: Path, outputs: Outputs) -> None:
    """Write a folder that ``judge`` takes.

    Raises:
        RecordError: It is not empty, or cannot be written.
    """
    check_empty(folder)
    write_atomically(folder / DESCRIPTION, _description(outputs).encode())
    if lines := _forces(outputs):
        write_atomically(folder / FORCES, "\n".join([*lines, ""]).encode())
    for trial, press in outputs.presses.items():
        place = folder / f"{trial:02d}"
        if press.image is not None:
            write_atomically(place / IMAGE, encode_png(press.image))
        if press.height_m is not None:
            write_atomically(place / HEIGHT, _saved(press.height_m))
        arrays = {} if press.pressure_pa is None else {PRESSURE: press.pressure_pa}
        if press.shear_pa is not None:
            arrays |= dict(zip(SHEAR, np.moveaxis(press.shear_pa, -1, 0), strict=True))
        if arrays:
            write_atomically(place / FIELDS, _saved(**arrays))


def _description(outputs: Outputs) -> str:
    """Return ``simulator.toml``; a string, number or list is in TOML what it is in JSON."""
    keys: dict[str, Any] = {
        **asdict(outputs.simulator),
        "colour_order": ColourOrder.RGB.value,
        "left_out": list(outputs.left_out),
    }
    lines = [f"{key} = {_toml(value)}" for key, value in keys.items() if value is not None]
    units = [f"{key} = {_toml(value)}" for key, value in WRITTEN_UNITS.items()]
    return "\n".join([*lines, "", "[units]", *units, ""])


def _toml(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def _forces(outputs: Outputs) -> list[str]:
    known = {
        trial: press
        for trial, press in outputs.presses.items()
        if press.force_n is not None or press.depth_m is not None
    }
    rows = [
        f"{trial},{_cell(press.force_n)},{_cell(press.depth_m)}" for trial, press in known.items()
    ]
    return ["press,force,depth", *rows] if rows else []


def _cell(value: float | None) -> str:
    return "" if value is None else repr(value)


def _saved(array: np.ndarray | None = None, **arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    if array is not None:
        np.save(buffer, array.astype(np.float32), allow_pickle=False)
    else:
        np.savez_compressed(
            buffer, allow_pickle=False, **{k: v.astype(np.float32) for k, v in arrays.items()}
        )
    return buffer.getvalue()
