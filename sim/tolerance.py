"""A tolerance of the pressing force, such as 1% or 0.02N, and how it is read."""

from dataclasses import dataclass

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import UNITS, Dimension, parse_quantity, split_quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How far off F_z may be: relative to F_z, or in newtons; exactly one of the two."""

    relative: float | None = None
    force_n: float | None = None  # of the largest force where there are several [N]

    def __post_init__(self) -> None:
        value = self.relative if self.force_n is None else self.force_n
        if (self.relative is None) == (self.force_n is None) or value is None or not value > 0.0:
            raise ConfigError(
                f"a tolerance of {value} is none", remedy="write it as 0.02N or 1%, above 0"
            )

    def of(self, force_n: float) -> float:
        """Return the tolerance relative to a force [N]; infinite for none."""
        if self.force_n is None:
            return self.relative or 0.0
        return self.force_n / force_n if force_n > 0.0 else float("inf")

    def __str__(self) -> str:
        if self.force_n is None:
            return f"{1e2 * (self.relative or 0.0):g}% of F_z"
        return f"{self.force_n:g} N"


def parse_tolerance(text: str, *, field: str) -> Tolerance:
    """Read ``0.02N`` or ``1%``; a number without a unit could be meant as either.

    Raises:
        ConfigError: Neither a force nor a share in percent, or not above zero.
    """
    parts = split_quantity(text)
    unit = "" if parts is None else parts[1]
    is_force = unit in UNITS[Dimension.FORCE]
    if not is_force and unit != "%":
        problem = "is no tolerance" if parts is None or unit else "has no unit"
        raise ConfigError(f'{field}: "{text}" {problem}', remedy="give 0.02N or 1%")
    dimension = Dimension.FORCE if is_force else Dimension.RATIO
    value = parse_quantity(text, dimension=dimension, field=field)
    return Tolerance(force_n=value) if is_force else Tolerance(relative=value)
