"""Field types of the configuration: text with a unit in the file, SI in the program; ranges."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Annotated, Any, ClassVar, Unpack

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    TypeAdapter,
    ValidationInfo,
    field_validator,
)
from pydantic_core import PydanticCustomError

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, example, parse_quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """The range of one field."""

    dimension: Dimension
    because: str  # reason, as a clause that follows a semicolon
    # Smallest value, as it is written; None where the field's type is enough
    least: str | None = None
    most: str | None = None  # largest value, likewise

    def crossed(self, value: float) -> tuple[str, float] | None:
        """Return ``"le"`` or ``"ge"`` and the bound [SI] that ``value`` [SI] is beyond, if any."""
        for name, bound, sign in (("le", self.most, 1.0), ("ge", self.least, -1.0)):
            if bound is not None:
                limit = parse_quantity(bound, dimension=self.dimension)
                if sign * value > sign * limit:
                    return name, limit
        return None


def _read() -> Mapping[str, Mapping[str, Ceiling]]:
    text = resources.files("tacauchy_rig.core.config").joinpath("ceilings.toml").read_text("utf-8")
    tables = tomllib.loads(text)
    return TypeAdapter(dict[str, dict[str, Ceiling]]).validate_python(tables)


CEILINGS = _read()
"""By table and field, in the order of the file."""


def ceilings() -> Iterator[tuple[str, Ceiling]]:
    """Yield dotted field and range, in the order of the file."""
    for table, fields in CEILINGS.items():
        for field, ceiling in fields.items():
            yield f"{table}.{field}", ceiling


class Section(BaseModel):
    """A table of ``rig.toml``: frozen, unknown keys refused.

    Attributes:
        ceilings: Ranges of its fields. A run that was recorded is read whatever it allowed.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False
    )
    ceilings: ClassVar[Mapping[str, Ceiling]] = {}

    def __init_subclass__(cls, *, ceilings: str = "", **options: Unpack[ConfigDict]) -> None:
        """Take the ranges of a table of ``ceilings.toml``."""
        super().__init_subclass__(**options)
        if ceilings:
            cls.ceilings = CEILINGS[ceilings]

    @field_validator("*", mode="before")
    @classmethod
    def _has_no_nul(cls, value: Any) -> Any:
        if isinstance(value, str) and "\0" in value:
            raise ValueError(f"{json.dumps(value)} holds a NUL character, which no path can")
        return value

    @field_validator("*")
    @classmethod
    def _below_its_ceiling(cls, value: Any, info: ValidationInfo) -> Any:
        ceiling = cls.ceilings.get(info.field_name or "")
        if ceiling is None or value is None or (info.context or {}).get("recorded"):
            return value
        for index, item in enumerate(value if isinstance(value, tuple) else (value,)):
            if (crossed := ceiling.crossed(item)) is not None:
                name, limit = crossed
                raise PydanticCustomError(
                    "ceiling", "ceiling", {name: limit, "index": index, "because": ceiling.because}
                )
        return value


def _reader(dimension: Dimension) -> BeforeValidator:
    def read(value: Any) -> float:
        if isinstance(value, str):
            try:
                return parse_quantity(value, dimension=dimension)
            except ConfigError as error:
                problem = error.message.removeprefix("value: ")
                raise ValueError(f'{problem}; write for example "{example(dimension)}"') from error
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if dimension is Dimension.RATIO and is_number:
            return float(value)
        raise ValueError(
            f"{json.dumps(value, default=str)} has no unit; a {dimension.value} is written as text "
            f'with its unit, for example "{example(dimension)}"'
        )

    return BeforeValidator(read)


Length = Annotated[float, Dimension.LENGTH, _reader(Dimension.LENGTH)]
Force = Annotated[float, Dimension.FORCE, _reader(Dimension.FORCE)]
Torque = Annotated[float, Dimension.TORQUE, _reader(Dimension.TORQUE)]
Time = Annotated[float, Dimension.TIME, _reader(Dimension.TIME)]
Speed = Annotated[float, Dimension.SPEED, _reader(Dimension.SPEED)]
Acceleration = Annotated[float, Dimension.ACCELERATION, _reader(Dimension.ACCELERATION)]
Angle = Annotated[float, Dimension.ANGLE, _reader(Dimension.ANGLE)]
Frequency = Annotated[float, Dimension.FREQUENCY, _reader(Dimension.FREQUENCY)]
ForceRate = Annotated[float, Dimension.FORCE_RATE, _reader(Dimension.FORCE_RATE)]
Mass = Annotated[float, Dimension.MASS, _reader(Dimension.MASS)]
Ratio = Annotated[float, Dimension.RATIO, _reader(Dimension.RATIO)]
Pressure = Annotated[float, Dimension.PRESSURE, _reader(Dimension.PRESSURE)]
