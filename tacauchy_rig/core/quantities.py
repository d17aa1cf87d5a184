"""Numbers with units: text such as ``5 mm`` or ``19.58px/mm`` to SI floats and back.

SI is used everywhere inside; conversion happens here, at configuration, wire and figure.
"""

import math
import re
import tomllib
from enum import StrEnum
from pathlib import Path

from tacauchy_rig.core.errors import ConfigError


class Dimension(StrEnum):
    """What a quantity measures; each has the units listed in ``UNITS``."""

    LENGTH = "length"
    FORCE = "force"
    TORQUE = "torque"
    PRESSURE = "pressure"
    TIME = "time"
    SPEED = "speed"
    ACCELERATION = "acceleration"
    ANGLE = "angle"
    ANGULAR_SPEED = "angular speed"
    FREQUENCY = "frequency"
    FORCE_RATE = "force rate"
    MASS = "mass"
    IMAGE_SCALE = "image scale"
    RATIO = "ratio"


_TABLES = tomllib.loads(Path(__file__).with_name("units.toml").read_text("utf-8"))
UNITS: dict[Dimension, dict[str, float]] = {each: _TABLES[each]["units"] for each in Dimension}
"""What numbers of each unit are multiplied by to be SI."""

_NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")
_COMMA = re.compile(r"^\s*[-+]?\d*,\d")

FREE = "free"
"""Metadata of a field that may hold any number; others are refused where files are read."""


def split_quantity(text: str) -> tuple[float, str] | None:
    """Return the number and the unit that ``text`` consists of, or None if it has no number."""
    match = _NUMBER.match(text)
    return (float(match.group(1)), match.group(2)) if match else None


def parse_quantity(text: str, *, dimension: Dimension, field: str = "value") -> float:
    """Read a number with a unit, and return it in the SI unit.

    Args:
        text: For example ``"5 mm"``, ``"0.3MPa"``, ``"3 %"``.

    Raises:
        ConfigError: The text has no number, a decimal comma, an infinite number, no unit, or a
            unit of another dimension.
    """
    units = UNITS[dimension]
    remedy = f'write it as text with a unit, for example {field} = "{example(dimension)}"'
    if _COMMA.match(text):
        problem = "has a comma in its number; write a decimal point"
        raise ConfigError(f'{field}: "{text}" {problem}', remedy=remedy)
    match = _NUMBER.match(text)
    if match is None:
        raise ConfigError(f'{field}: "{text}" is not a number with a unit', remedy=remedy)
    number, unit = match.groups()
    if unit not in units:
        listed = ", ".join(known or "no unit" for known in units)
        problem = f'has the unit "{unit}"' if unit else "has no unit"
        article = "an" if dimension[0] in "ai" else "a"
        raise ConfigError(
            f'{field}: "{text}" {problem}; {article} {dimension.value} needs one of: {listed}',
            remedy=remedy,
        )
    value = _scaled(number, units[unit])
    if not math.isfinite(value):
        raise ConfigError(f'{field}: "{text}" is not a finite number', remedy=remedy)
    return value


def _scaled(number: str, factor: float) -> float:
    """Return a number times a factor; by a power of ten just what the shifted digits say.

    So 0.35 mm is the same float as 0.35e-3, where 0.35 * 1e-3 need not be.
    """
    shift = math.log10(factor)
    if not shift.is_integer():
        return float(number) * factor
    digits, _, exponent = number.lower().partition("e")
    return float(f"{digits}e{int(exponent or 0) + int(shift)}")


def example(dimension: Dimension) -> str:
    """Return a quantity as one writes it, for example ``5 mm``."""
    return str(_TABLES[dimension]["example"])
