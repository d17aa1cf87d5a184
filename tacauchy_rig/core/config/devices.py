"""What ``rig.toml`` may say of arm, force sensor and camera. Values are SI."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from tacauchy_rig.core.config.fields import (
    CEILINGS,
    Acceleration,
    Angle,
    Force,
    Frequency,
    Length,
    Mass,
    Section,
    Speed,
    Time,
)
from tacauchy_rig.core.registry import Kind, unknown

EMULATED = "emulated"
MOCK = "mock"
IMPORTED = "imported"
"""What was recorded elsewhere, by whatever it was: nothing is known of its devices."""


def _driver(kind: Kind) -> BeforeValidator:
    """Admit a name that the registry knows, and any name of a run that was recorded elsewhere."""

    def check(value: object, info: ValidationInfo) -> object:
        is_recorded = isinstance(value, str) and bool((info.context or {}).get("recorded"))
        if not is_recorded and (problem := unknown(kind, value)):
            raise ValueError(problem)
        return value

    return BeforeValidator(check)


def _is_sign(value: int) -> int:
    if value not in (-1, 1):
        raise ValueError(f"{value} is neither 1 nor -1")
    return value


Sign = Annotated[int, AfterValidator(_is_sign)]


class DeviceSection(Section):
    """A device by the name that the registry knows it by.

    ``options`` is for drivers of other packages: what theirs need and ours do not.
    """

    driver: str
    options: dict[str, bool | int | float | str] = Field(
        default_factory=dict, exclude_if=lambda options: not options
    )

    @property
    def is_emulated(self) -> bool:
        """True when the run starts the device as a process of its own."""
        return self.driver == EMULATED

    @property
    def is_imported(self) -> bool:
        """True where others recorded, with a device that nobody here knows."""
        return self.driver == IMPORTED

    @property
    def is_stand_in(self) -> bool:
        """True for a device that is emulated or a mock."""
        return self.driver in (EMULATED, MOCK)

    @property
    def is_real(self) -> bool:
        """True for a device that this program can reach; drivers of other packages are such."""
        return not self.is_stand_in and not self.is_imported


class RobotModel(StrEnum):
    """Generation of the controller: it decides rates, flags and what the arm can do."""

    CB3 = "cb3"
    E_SERIES = "e-series"

    @property
    def rate_hz(self) -> float:
        """Rate at which the controller reports its state [Hz]."""
        return 125.0 if self is RobotModel.CB3 else 500.0

    @property
    def major_version(self) -> int:
        """Major version of the controller software that drives this generation."""
        return 3 if self is RobotModel.CB3 else 5


class Checksum(StrEnum):
    """Checksum of the force sensor's frames."""

    SUM = "SUM"
    CRC32 = "CRC32"


class RobotSection(DeviceSection):
    """The arm, the pose above the gel it starts from, and its speeds.

    ``home`` is the tip's position (x, y, z) in the base frame, above the gel, and
    ``tool_rotation`` its rotation vector there: the indenter points straight down. The controller
    stops the arm when this program is not heard from at the rate ``watchdog``. ``force_sign`` times
    its own estimate of force, Fz in the base frame, rises while the indenter is pressed.
    """

    ceilings = CEILINGS["robot"]

    driver: Annotated[str, _driver(Kind.ARM)]
    model: RobotModel
    host: str
    home: tuple[Length, Length, Length]
    tool_rotation: tuple[Angle, Angle, Angle]
    tcp_offset: tuple[Length, Length, Length]
    payload: Mass = Field(ge=0)
    approach_speed: Speed = Field(gt=0)
    search_speed: Speed = Field(gt=0)
    press_speed: Speed = Field(gt=0)
    retract_speed: Speed = Field(gt=0)
    acceleration: Acceleration = Field(gt=0)
    watchdog: Frequency = Field(ge=2, le=50)
    connect_timeout: Time = Field(gt=0, le=60)
    force_sign: Sign = 1


class ForceSensorSection(DeviceSection):
    """The force sensor. Capacity and overload come from its own calibration sheet.

    ``compression_sign`` times the raw Fz is positive while the indenter is pressed. ``to_tip`` is
    how far the indenter's tip lies from the point that the moments refer to, along the tool's axis;
    without it no real cell's moments tell how the tool leans. ``delay`` is how much later than the
    arm's state of the same moment a sample is stamped; reports correct it.
    """

    ceilings = CEILINGS["force_sensor"]

    driver: Annotated[str, _driver(Kind.FORCE_SENSOR)]
    port: str
    baud_rate: int = Field(ge=9600, le=4_000_000)
    rate: Frequency = Field(ge=50, le=1000)
    checksum: Checksum
    compression_sign: Sign
    capacity: Force = Field(gt=0)
    calibration_sheet: str
    connect_timeout: Time = Field(gt=0, le=60)
    to_tip: Length | None = None
    delay: Time


class CameraSection(DeviceSection):
    """The camera: by name or serial number, ``/dev/...`` path, or URL; never by list order.

    ``delay`` is how much later than the arm's state of the same moment a frame is stamped; reports
    correct it.
    """

    ceilings = CEILINGS["camera"]

    driver: Annotated[str, _driver(Kind.CAMERA)]
    device: str
    width: int = Field(ge=160, le=8192)
    height: int = Field(ge=120, le=8192)
    rate: Frequency = Field(ge=1, le=240)
    exposure: int | None = None
    gain: int | None = None
    white_balance: int | None = None
    connect_timeout: Time = Field(gt=0, le=60)
    delay: Time
