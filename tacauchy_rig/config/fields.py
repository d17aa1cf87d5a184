"""Field types of the configuration: text with a unit in the file, SI floats in the program."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity


class Section(BaseModel):
    """A table of ``rig.toml``: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


def _reader(dimension: Dimension) -> BeforeValidator:
    def read(value: Any) -> float:
        if isinstance(value, str):
            try:
                return parse_quantity(value, dimension=dimension).value
            except ConfigError as error:
                raise ValueError(str(error).removeprefix("value: ")) from error
        if dimension is Dimension.RATIO and isinstance(value, int | float):
            return float(value)
        raise ValueError(
            f"{value!r} has no unit; a {dimension.value} is written as text with its unit"
        )

    return BeforeValidator(read)


Length = Annotated[float, _reader(Dimension.LENGTH)]
Force = Annotated[float, _reader(Dimension.FORCE)]
Torque = Annotated[float, _reader(Dimension.TORQUE)]
Time = Annotated[float, _reader(Dimension.TIME)]
Speed = Annotated[float, _reader(Dimension.SPEED)]
Acceleration = Annotated[float, _reader(Dimension.ACCELERATION)]
Angle = Annotated[float, _reader(Dimension.ANGLE)]
Frequency = Annotated[float, _reader(Dimension.FREQUENCY)]
ForceRate = Annotated[float, _reader(Dimension.FORCE_RATE)]
Mass = Annotated[float, _reader(Dimension.MASS)]
Ratio = Annotated[float, _reader(Dimension.RATIO)]
Pressure = Annotated[float, _reader(Dimension.PRESSURE)]
