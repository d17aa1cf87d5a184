"""Field types of the configuration: text with a unit in the file, SI floats in the program."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from tacauchy_rig.core.config.fields import NO_CEILINGS, Ceiling
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, example, parse_quantity


class Section(BaseModel):
    """A table of ``rig.toml``: frozen, unknown keys refused.

    Attributes:
        ceilings: Ranges of its fields. A run that was recorded is read whatever it allowed.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False
    )
    ceilings: ClassVar[Mapping[str, Ceiling]] = NO_CEILINGS

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
