"""A plan of presses: ``PLAN.toml`` as it is written."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.special import ndtri

from tacauchy_rig.app.importing.table import read_section
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.fields import Length, Ratio, Section
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity

PRESSES_MOST = 1_000_000
"""Of one plan; an index of so many is read at once."""
STATED = "stated"
"""As ``press.material``: the uncertainty that the sensor's file states."""
# Of a normal distribution: what is drawn beyond is taken to be there.
_DEVIATIONS_MOST = 3.0


class Design(StrEnum):
    """How the values of several variables are combined."""

    GRID = "grid"
    LIST = "list"
    LATIN_HYPERCUBE = "latin-hypercube"
    SOBOL = "sobol"


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """The values of a variable: choices, a range, or a normal distribution."""

    choices: tuple[Any, ...] = ()  # what it may be; of a range, its steps
    # The ends of a range, or mean and standard deviation
    between: tuple[float, float] | None = None
    is_normal: bool = False  # it is the latter
    # Its logarithm is normal, so that no stiffness is negative however uncertain
    is_ratio: bool = False

    def at(self, shares: FloatArray) -> list[Any]:
        """Return the values that such shares of it lie below, each share from 0 to 1."""
        if self.between is None:
            count = len(self.choices)
            return [self.choices[min(int(share * count), count - 1)] for share in shares]
        first, second = self.between
        if not self.is_normal:
            return list((first + shares * (second - first)).tolist())
        deviations = np.clip(ndtri(shares), -_DEVIATIONS_MOST, _DEVIATIONS_MOST)
        drawn = first + second * deviations
        if self.is_ratio:
            drawn = first * (1.0 + second / first) ** deviations
        return list(drawn.tolist())


_NOUGHT, _ONE = Spread(choices=(0.0,)), Spread(choices=(1.0,))


def _spread(dimension: Dimension | None) -> BeforeValidator:
    def one(value: Any) -> Any:
        if dimension is not None:
            return _number(value, dimension)
        if not isinstance(value, str):
            raise ValueError("is no text; write it in quotes")
        return value

    def read(value: Any) -> Spread:
        if isinstance(value, Spread):
            return value
        if value == STATED and dimension is Dimension.RATIO:
            return Spread(between=(1.0, math.nan), is_normal=True, is_ratio=True)
        if not isinstance(value, dict):
            given = value if isinstance(value, list) else [value]
            if not given:
                raise ValueError("is an empty list; give at least one value")
            return Spread(choices=tuple(map(one, given)))
        if dimension is not None and set(value) == {"value", "uncertainty"}:
            return Spread(between=(one(value["value"]), one(value["uncertainty"])), is_normal=True)
        if dimension is None or {"from", "to"} != set(value) - {"steps"}:
            raise ValueError("write a value, a list, {from, to, steps} or {value, uncertainty}")
        ends, steps = (one(value["from"]), one(value["to"])), value.get("steps", 0)
        if not isinstance(steps, int) or not 0 <= steps <= PRESSES_MOST:
            raise ValueError(f"steps = {steps!r} is no whole number up to {PRESSES_MOST}")
        return Spread(choices=tuple(np.linspace(*ends, steps).tolist()), between=ends)

    return BeforeValidator(read)


def _number(value: Any, dimension: Dimension) -> float:
    try:
        return parse_quantity(str(value), dimension=dimension)
    except ConfigError as error:
        raise ValueError(f"{error.message.removeprefix('value: ')}; {error.remedy}") from error


Texts = Annotated[Spread, _spread(None)]
Lengths = Annotated[Spread, _spread(Dimension.LENGTH)]
Forces = Annotated[Spread, _spread(Dimension.FORCE)]
Angles = Annotated[Spread, _spread(Dimension.ANGLE)]
Ratios = Annotated[Spread, _spread(Dimension.RATIO)]


class Press(Section):
    """``[press]``: what is varied; see ``example.toml``."""

    sensor: Texts
    indenter: Texts
    size: Lengths | None = None
    x: Lengths = _NOUGHT
    y: Lengths = _NOUGHT
    depth: Lengths | None = None
    force: Forces | None = None
    shift_x: Lengths = _NOUGHT
    shift_y: Lengths = _NOUGHT
    twist: Angles = _NOUGHT
    tilt_x: Angles = _NOUGHT
    tilt_y: Angles = _NOUGHT
    material: Ratios = _ONE
    friction: Ratios = _NOUGHT
    light: Ratios = _ONE
    noise: Ratios = _NOUGHT


class Simulation(Section):
    """``[simulation]``: what all rows are computed with.

    Attributes:
        edge: Of elements at the gel's surface [m].
        tolerance: Presses that state a larger force error are computed again with smaller elements.
        optics: What ``calibrate optics`` wrote, of the plan's only sensor; None is its nominal one.
        background: Its no-contact frame; None is an even grey.
        samples: Of a pixel, both ways.
        cell: Pixels of a cell of pressure and shear, both ways.
        shard: Presses that are computed together and share a file.
    """

    edge: Length = Field(default=1.25e-3, validate_default=False, ge=0.4e-3, le=5e-3)
    tolerance: Annotated[Ratio, Field(ge=0.005, le=1.0)] = 1.0
    optics: Path | None = None
    background: Path | None = None
    samples: Annotated[int, Field(ge=1, le=4)] = 2
    cell: Annotated[int, Field(ge=1, le=64)] = 8
    shard: Annotated[int, Field(ge=1, le=1000)] = 50


class Description(Section):
    """``[dataset]``: what the datasheet says."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]*$", max_length=80)] = "presses"
    creator: str = ""
    licence: str = "CC-BY-4.0"


class Plan(Section):
    """A file of a plan."""

    design: Design
    count: Annotated[int, Field(ge=1, le=PRESSES_MOST)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    press: Press
    simulation: Simulation = Simulation()
    dataset: Description = Description()


def read_plan(path: Path) -> Plan:
    """Read a plan.

    Raises:
        ConfigError: No such file, not TOML, or a key is unknown, missing or wrong; one line each.
    """
    try:
        tables = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(
            f"{path}: {getattr(error, 'strerror', None) or error}", remedy=_EXAMPLE
        ) from error
    try:
        return read_section(Plan, tables)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error.message}", remedy=_EXAMPLE) from error


_EXAMPLE = "`tacauchy-rig sweep --example > plan.toml` writes a plan with comments"
