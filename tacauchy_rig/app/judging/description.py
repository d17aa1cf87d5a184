"""``simulator.toml``: who simulated, in which units, and what it took."""

from __future__ import annotations

import tomllib

from pydantic import Field

from tacauchy_rig.app.importing.source import MIB, Source
from tacauchy_rig.app.importing.spec import Column, read_section
from tacauchy_rig.core.config.fields import Section
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.outputs import Driven, Simulator
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.rgb import ColourOrder

DESCRIPTION = "simulator.toml"
FORCES = "forces.csv"
IMAGE, HEIGHT, FIELDS = "image.png", "height.npy", "fields.npz"
PRESSURE, SHEAR = "pressure", ("shear_x", "shear_y")


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

    def column(self, name: str, *, file: str) -> Column:
        """Return a column of numbers with its unit; ``name`` is a unit's here.

        Raises:
            ConfigError: The unit is not stated, or is of something else.
        """
        unit, dimension = getattr(self, name), DIMENSIONS[name]
        if unit is None:
            raise ConfigError(
                f"{DESCRIPTION}: units.{name} is not stated, and {file} has numbers of it",
                remedy=f"write {name} under [units]: one of {', '.join(UNITS[dimension])}",
            )
        column = Column(column=name, unit=unit)
        column.factor(dimension, field=f"{DESCRIPTION}: units.{name}")
        return column


DIMENSIONS = {
    "force": Dimension.FORCE,
    "depth": Dimension.LENGTH,
    "height": Dimension.LENGTH,
    "pressure": Dimension.PRESSURE,
}


class Description(Section):
    """All of ``simulator.toml``; what is not said here is as ``Simulator`` has it.

    Attributes:
        colour_order: Of ``image.png``; has to be said where there is one.
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

    @property
    def simulator(self) -> Simulator:
        """What it says of the simulator."""
        return Simulator(
            name=self.name,
            version=self.version,
            milliseconds_an_image=self.milliseconds_an_image,
            machine=self.machine,
            fitted_to_these=self.fitted_to_these,
            driven_by=self.driven_by,
            note=self.note,
        )


def read_description(source: Source) -> Description:
    """Read what a folder says of itself.

    Raises:
        RecordError: It has no ``simulator.toml``.
        ConfigError: That is damaged, or says what it may not.
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
