"""The plain layout of a simulator's folder: ``simulator.toml`` and one folder a press.

Other people write it and ``judge`` reads it; docs/reference/file-formats.md describes it.
"""

from __future__ import annotations

import io
import tomllib
from dataclasses import asdict, fields
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing.source import MIB, Source
from tacauchy_rig.app.importing.table import Column, as_csv, as_toml, read_section
from tacauchy_rig.core.arrays import AnyArray
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
DIMENSIONS = {
    "force": Dimension.FORCE,
    "depth": Dimension.LENGTH,
    "height": Dimension.LENGTH,
    PRESSURE: Dimension.PRESSURE,
}


class Signs(Section):
    """``[signs]``: -1 where numbers count the other way."""

    force: Literal[1, -1] = 1
    depth: Literal[1, -1] = 1
    height: Literal[1, -1] = 1
    pressure: Literal[1, -1] = 1


class Units(Section):
    """``[units]``: of what stands in files without one; that of pressure is of shear, too."""

    force: str | None = None
    depth: str | None = None
    height: str | None = None
    pressure: str | None = None


class Description(Section):
    """All of ``simulator.toml``; the rest is as in ``Simulator``."""

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

    def column(self, name: str, *, file: str) -> Column:
        """Return a column of a name of ``DIMENSIONS`` with its unit and sign.

        Raises:
            ConfigError: The unit is not stated, or is of something else.
        """
        unit, dimension = getattr(self.units, name), DIMENSIONS[name]
        if unit is None:
            raise ConfigError(
                f"{DESCRIPTION}: units.{name} is not stated, and {file} has numbers of it",
                remedy=f"write {name} under [units]: one of {', '.join(UNITS[dimension])}",
            )
        column = Column(column=name, unit=unit, sign=getattr(self.signs, name))
        column.factor(dimension, field=f"{DESCRIPTION}: units.{name}")
        return column

    def factor(self, name: str, *, file: str) -> float:
        """Return what numbers of a file are multiplied by to be SI; raises as ``column``."""
        return self.column(name, file=file).factor(DIMENSIONS[name], field=DESCRIPTION)


def read_description(source: Source) -> Description:
    """Read the description of a folder.

    Raises:
        RecordError: It has no ``simulator.toml``.
        ConfigError: It is damaged, or has a value that is not allowed.
    """
    data = source.read(DESCRIPTION, field="the simulator's description", most_bytes=MIB)
    remedy = "docs/reference/file-formats.md shows one"
    try:
        tables = tomllib.loads(data.decode())
    except ValueError as error:
        raise ConfigError(
            f"{source.root / DESCRIPTION}: no TOML: {error}", remedy=remedy
        ) from error
    return read_section(Description, tables, where=f"{DESCRIPTION}: ")


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
    about = {
        **asdict(outputs.simulator),
        "colour_order": ColourOrder.RGB.value,
        "left_out": list(outputs.left_out),
    }
    known = {key: value for key, value in about.items() if value is not None}
    units = {"force": "N", "depth": "m", "height": "m", PRESSURE: "Pa"}
    write_atomically(folder / DESCRIPTION, f"{as_toml(known)}\n[units]\n{as_toml(units)}".encode())
    pairs = [(trial, press.force_n, press.depth_m) for trial, press in outputs.presses.items()]
    if rows := [row for row in pairs if row[1:] != (None, None)]:
        write_atomically(folder / FORCES, as_csv([("press", "force", "depth"), *rows]))
    for trial, press in outputs.presses.items():
        place = folder / f"{trial:02d}"
        if press.image is not None:
            write_atomically(place / IMAGE, encode_png(press.image))
        if press.height_m is not None:
            buffer = io.BytesIO()
            np.save(buffer, press.height_m.astype(np.float32), allow_pickle=False)
            write_atomically(place / HEIGHT, buffer.getvalue())
        arrays: dict[str, AnyArray] = {}
        if press.pressure_pa is not None:
            arrays[PRESSURE] = press.pressure_pa
        if press.shear_pa is not None:
            arrays |= dict(zip(SHEAR, np.moveaxis(press.shear_pa, -1, 0), strict=True))
        if arrays:
            buffer, single = io.BytesIO(), {k: v.astype(np.float32) for k, v in arrays.items()}
            np.savez_compressed(buffer, allow_pickle=False, **single)
            write_atomically(place / FIELDS, buffer.getvalue())
