"""What ``import.toml`` may say. Values are SI; the file writes them as text with units."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Any, TypeVar

from pydantic import Field, ValidationError, field_validator

from tacauchy_rig.core.config.fields import Section
from tacauchy_rig.core.config.load import leaves
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import UNITS, Dimension

T = TypeVar("T", bound=Section)

_LINES_MOST = 40  # of a message: what one may mend before looking again
_VALUE_MOST = 120  # characters of a value in a message
RIG_TABLES = ("sensor", "replay", "report", "uncertainty")
RIG_FIELDS = ("force_sensor.to_tip", "force_sensor.compression_sign", "robot.tool_rotation")
"""What of ``rig.toml`` a source may say: the rest is of devices that it does not have."""
PATH_FIELDS = ("sensor.name", "sensor.optics_calibration")
"""Of these, names that may be files: they are looked for in the folder."""


class SourceKind(StrEnum):
    """Formats that can be imported."""

    CSV = "csv"
    BAG = "bag"
    TAXIM = "taxim"
    VIDEO = "video"
    RECORDS = "records"
    LEROBOT = "lerobot"


class Spec(Section):
    """All of ``import.toml``.

    Attributes:
        name: Of the run; what the format suggests, if left out.
        simulated: The presses are of a simulator or an emulator.
        data: Of the source; its kind says what may stand there.
        rig: What the run's ``rig.toml`` is to say of sensor, replay and report.
    """

    kind: SourceKind
    name: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]{1,60}$")
    simulated: bool = False
    data: dict[str, Any]
    rig: dict[str, Any]

    @field_validator("rig")
    @classmethod
    def _is_of_the_replay(cls, tables: dict[str, Any]) -> dict[str, Any]:
        for name, _ in leaves(tables):
            if name.partition(".")[0] not in RIG_TABLES and name not in RIG_FIELDS:
                known = ", ".join((*(f"rig.{table}" for table in RIG_TABLES), *RIG_FIELDS))
                raise ValueError(f'"{name}" says nothing of an imported run; it may say: {known}')
        return tables


class Column(Section):
    """A column with numbers: its name, and the unit of what stands in it."""

    column: str
    unit: str

    def factor(self, dimension: Dimension, *, field: str) -> float:
        """Return what its numbers are to be multiplied by to be SI.

        Raises:
            ConfigError: The unit is not of the dimension.
        """
        units = UNITS[dimension]
        if self.unit not in units:
            raise ConfigError(
                f'{field}.unit: "{self.unit}" is no unit of a {dimension.value}',
                remedy=f"one of: {', '.join(unit for unit in units if unit)}",
            )
        return units[self.unit]


def read_section(kind: type[T], tables: Any, *, where: str = "") -> T:
    """Return a table of ``import.toml`` as what it is to be.

    Args:
        kind: Of the table.
        tables: As it was written.
        where: Its name, with a dot; for messages.

    Raises:
        ConfigError: One line for each field that is wrong.
    """
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        lines = [f"{where}{_line(problem, kind)}" for problem in error.errors()[:_LINES_MOST]]
        raise ConfigError(
            "\n".join(lines), remedy="docs/reference/file-formats.md shows each format"
        ) from error


def _line(problem: Any, kind: type[Section]) -> str:
    """Return what is wrong with a field, in one line."""
    name = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "missing":
        return f"{name}: missing"
    if problem["type"] == "extra_forbidden" and len(problem["loc"]) == 1:
        return f"{name}: unknown key; known here: {', '.join(kind.model_fields)}"
    if problem["type"] == "extra_forbidden":
        return f"{name}: unknown key"
    value = json.dumps(problem["input"], ensure_ascii=False, default=str)[:_VALUE_MOST]
    return f"{name}: {value}: {problem['msg'].removeprefix('Value error, ')}"
