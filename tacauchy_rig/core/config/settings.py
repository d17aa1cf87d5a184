"""The keys of ``rig.toml``. Values are SI; the file writes them as text with units.

Ranges with their reasons stand in ``ceilings.toml``, rules between keys in ``rules.py``. Each field
of ``[uncertainty]`` that is left out takes a default with its source;
``docs/explanation/uncertainty.md`` lists them. A uniform distribution of half width a has the
standard uncertainty a / sqrt(3) (GUM 4.3.7).
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal, NoReturn, Self

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from tacauchy_rig.core.config.field_ranges import (
    Acceleration,
    Angle,
    Force,
    ForceRate,
    Frequency,
    Length,
    Mass,
    Pressure,
    Ratio,
    Section,
    Speed,
    Time,
    Torque,
)
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, unknown

EMULATED = "emulated"
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


Sign = Literal[-1, 1]
Lamp = Annotated[int, Field(ge=0, le=15)]


class Options(dict[str, bool | int | float | str]):
    """What a driver of another package asks for; a key that the file lacks is no program fault."""

    def __missing__(self, key: str) -> NoReturn:
        raise ConfigError(f"options: {key} is missing", remedy="add it below the device's options")


class DeviceSection(Section):
    """A device by the name that the registry knows it by.

    ``options`` is for drivers of other packages: what theirs need and ours do not.
    """

    driver: str
    options: Annotated[dict[str, bool | int | float | str], AfterValidator(Options)] = Field(
        default_factory=Options, exclude_if=lambda options: not options
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
    def is_real(self) -> bool:
        """True for a device that this program can reach; drivers of other packages are such."""
        return not self.is_emulated and not self.is_imported


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


class RobotSection(DeviceSection, ceilings="robot"):
    """The arm, the pose above the gel it starts from, and its speeds.

    ``home`` is the tip's position (x, y, z) in the base frame, above the gel, and
    ``tool_rotation`` its rotation vector there: the indenter points straight down. The controller
    stops the arm when this program is not heard from at the rate ``watchdog``. ``force_sign`` times
    its own estimate of force, Fz in the base frame, rises while the indenter is pressed.
    """

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


class ForceSensorSection(DeviceSection, ceilings="force_sensor"):
    """The force sensor. Capacity and overload come from its own calibration sheet.

    ``compression_sign`` times the raw Fz is positive while the indenter is pressed. ``to_tip`` is
    how far the indenter's tip lies from the point that the moments refer to, along the tool's axis;
    without it a real cell's moments cannot give the tool's tilt. ``delay`` is how much later than
    the arm's state of the same moment a sample is stamped; reports correct it.
    """

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


class CameraSection(DeviceSection, ceilings="camera"):
    """The camera: by name or serial number, ``/dev/...`` path, or URL; never by list order.

    ``rate`` is what it delivers, left out the sensor file's. ``delay`` is how much later than the
    arm's state of the same moment a frame is stamped; reports correct it. ``leds`` are a DIGIT's
    red, green and blue lamps, 0 to 15.
    """

    driver: Annotated[str, _driver(Kind.CAMERA)]
    device: str
    width: int = Field(ge=160, le=8192)
    height: int = Field(ge=120, le=8192)
    rate: Frequency = Field(ge=1, le=240)
    exposure: int | None = None
    gain: int | None = None
    white_balance: int | None = None
    leds: tuple[Lamp, Lamp, Lamp] | None = None
    connect_timeout: Time = Field(gt=0, le=60)
    delay: Time


class SyncMode(StrEnum):
    """What ties the streams together in time; hardware does by ``external_trigger`` alone.

    The last two are of imported runs.
    """

    HOST_CLOCK = "host_clock"
    DO_MARKER = "do_marker"
    TAP_CALIBRATED = "tap_calibrated"
    EXTERNAL_TRIGGER = "external_trigger"
    CONTACT_ONSET = "contact_onset"
    UNKNOWN = "unknown"


class RunSection(Section):
    """Name and place of a run."""

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    output_directory: str
    operator: str
    sync_mode: SyncMode


class IndenterKind(StrEnum):
    """Shape of the indenter's tip."""

    CYLINDER = "cylinder"
    SPHERE = "sphere"


class IndenterSection(Section):
    """The rigid body that is pressed into the gel."""

    kind: IndenterKind
    diameter: Length = Field(gt=0.0005, lt=0.05)
    height: Length = Field(gt=0, lt=0.2)
    fillet: Length = Field(ge=0)

    @model_validator(mode="after")
    def _fillet_fits(self) -> Self:
        if self.fillet >= self.diameter / 2:
            raise ValueError(
                f"fillet = {self.fillet * 1e3:g} mm does not fit a radius of "
                f"{self.diameter * 500:g} mm; give a smaller fillet"
            )
        return self


class SensorSection(Section, ceilings="sensor"):
    """The tactile sensor, and where its gel lies in the robot's base frame.

    ``name`` is a built-in sensor or the path of a TOML file; ``optics_calibration`` is what
    ``calibrate optics`` wrote, or empty where an emulated sensor is calibrated by itself.
    ``surface`` is the highest point of the unloaded gel (x, y, z); x and y are aimed at, z is only
    expected: contact is found by force.
    """

    name: str
    optics_calibration: str
    surface: tuple[Length, Length, Length]
    surface_uncertainty: Length = Field(gt=0)


class WorkspaceSection(Section, ceilings="workspace"):
    """Box in the base frame that the tip never leaves, and how far the tool may tilt."""

    x_min: Length
    x_max: Length
    y_min: Length
    y_max: Length
    z_min: Length
    z_max: Length
    max_tilt: Angle = Field(gt=0)
    home_radius: Length = Field(gt=0)


class LimitsSection(Section, ceilings="limits"):
    """Limits of the guard, compared with every force sample and every state of the arm.

    An arm that covers less than a quarter of its commanded travel for ``no_motion`` is stopped.
    ``allow_unchecked_force`` lets an arm that hardly feels press by a cell that no weight checked.
    """

    soft_force: Force = Field(gt=0)
    hard_force: Force = Field(gt=0)
    lateral_force: Force = Field(gt=0)
    moment: Torque = Field(gt=0)
    force_rate: ForceRate = Field(gt=0)
    early_contact: Force = Field(gt=0)
    max_depth: Length = Field(gt=0)
    stale_force: Time = Field(gt=0, le=0.5)
    stale_robot: Time = Field(gt=0, le=0.5)
    stale_image: Time = Field(gt=0, le=2.0)
    no_motion: Time = Field(default=0.7, ge=0.2, le=5.0)
    corrupt_ratio: Ratio = Field(gt=0, le=1)
    repeat_count: int = Field(ge=3)
    allow_unchecked_force: bool = False


class ProtocolSection(Section, ceilings="protocol"):
    """The six presses: targets, tolerances, windows and gates.

    After its dwell a press sways up and down for ``sway``, which shows how late the streams are.
    """

    force_targets: tuple[Force, ...] = Field(min_length=1, max_length=100)
    force_tolerance: Force = Field(gt=0)
    contact_force: Force = Field(gt=0)
    approach_height: Length = Field(gt=0)
    air_press_height: Length = Field(gt=0)
    search_travel: Length = Field(gt=0)
    tare_duration: Time = Field(gt=0.1)
    tare_deviation: Force = Field(gt=0)
    tare_mean: Force = Field(gt=0)
    reference_duration: Time = Field(gt=0)
    settle_timeout: Time = Field(gt=0)
    dwell_duration: Time = Field(ge=1.0)
    dwell_force_rate: ForceRate = Field(gt=0)
    drift: Force = Field(gt=0)
    press_timeout: Time = Field(gt=0)
    sway: Time = Field(ge=0)
    attempts: int = Field(ge=1)
    min_force_rate: Frequency = Field(gt=0)
    min_image_rate: Frequency = Field(gt=0)


class ModulusSource(StrEnum):
    """Where the gel's modulus comes from."""

    STATED = "stated"
    DEPTHS = "depths"


class PoseSource(StrEnum):
    """Where the indenter's tilt and offset come from."""

    STATED = "stated"
    FOUND = "found"


class ReplaySection(Section, ceilings="replay"):
    """How trials are replayed: model settings that override the sensor's file.

    ``preset`` ``auto`` is the cheapest that promises F_z within 3 %, or ``balanced`` where none
    does. ``tolerance``, such as ``0.02N`` or ``1%``, chooses in place of ``preset``. With
    ``modulus`` ``depths`` the stated modulus, of all layers, is multiplied by what makes the
    simulated forces at the run's measured depths agree with the measured ones; ``young`` is taken
    as it is. ``law`` is the gel's constitutive law, ``friction`` Coulomb's coefficient between
    indenter and gel; with ``relaxation`` a gel relaxes if its file says how. ``indenter``, as
    ``press --indenter`` has it, takes the place of ``[indenter]``: ``mesh:tool.stl,unit=mm`` is one
    of triangles. ``tilt`` is that of the indenter's axis towards x and y, ``offset`` where it comes
    down relative to ``sensor.surface``; with ``pose`` ``found`` the values from moments and images
    take their place. ``time_limit`` is that of one press.
    """

    force_tolerance: Force = Field(gt=0)
    preset: str
    tolerance: str | None = None
    drive: str
    modulus: ModulusSource = ModulusSource.STATED
    young: Pressure | None = Field(default=None, gt=0)
    poisson: float | None = Field(default=None, gt=-1, lt=0.5)
    law: str | None = None
    friction: Ratio = Field(default=0.0, ge=0)
    relaxation: bool = True
    indenter: str | None = None
    pose: PoseSource = PoseSource.STATED
    tilt: tuple[Angle, Angle] | None = None
    offset: tuple[Length, Length] | None = None
    time_limit: Time = Field(default=1800.0, gt=0)


class ReportSection(Section, ceilings="report"):
    """What a replay must reach for the verdict; ``docs/explanation/verdict.md`` has the reasons."""

    min_force_margin: Ratio = Field(ge=1)
    max_contact_residual: Ratio = Field(gt=0)
    max_contact_offset: Length = Field(gt=0)
    coverage_factor: Ratio = Field(gt=0)
    min_modulus_trials: int = Field(ge=2)
    max_force_mismatch: Force = Field(gt=0)


class VideoDeviceName(StrEnum):
    """Cameras that the emulated one can play through V4L2."""

    GELSIGHT_MINI = "gelsight-mini"
    DIGIT = "digit"


class EmulationSection(Section, ceilings="emulation"):
    """The emulated world, for every device whose driver is ``emulated``.

    ``friction`` is Coulomb's coefficient between indenter and gel; ``tilt``, how far the indenter's
    axis leans towards base x and y, takes the place of what the seed draws. The camera serves a
    stream over HTTP, or with ``video_device`` plays that camera through V4L2.
    """

    seed: int = Field(ge=0)
    robot_host: str
    video_device: VideoDeviceName | None = None
    markers: bool = False
    friction: Ratio = Field(default=0.0, ge=0)
    tilt: tuple[Angle, Angle] | None = None
    faults: tuple[str, ...] = ()


class UncertaintySection(Section, ceilings="uncertainty"):
    """Standard uncertainties of the press; what is left out takes its default.

    ``diameter``, ``fillet``, ``friction`` are of the indenter, ``tilt`` and ``offset`` of how it is
    mounted where neither moments nor images give it, ``depth`` of the difference of two heights of
    the arm, ``force_scale`` of the cell's reading, ``delay`` between force and height.
    """

    diameter: Length | None = Field(default=None, ge=0)
    fillet: Length | None = Field(default=None, ge=0)
    friction: Ratio | None = Field(default=None, ge=0)
    tilt: Angle | None = Field(default=None, ge=0)
    offset: Length | None = Field(default=None, ge=0)
    depth: Length | None = Field(default=None, ge=0)
    force_scale: Ratio | None = Field(default=None, ge=0)
    delay: Time | None = Field(default=None, ge=0)


class RigConfig(Section):
    """All of ``rig.toml``."""

    run: RunSection
    robot: RobotSection
    force_sensor: ForceSensorSection
    camera: CameraSection
    indenter: IndenterSection
    sensor: SensorSection
    workspace: WorkspaceSection
    limits: LimitsSection
    protocol: ProtocolSection
    replay: ReplaySection
    report: ReportSection
    emulation: EmulationSection
    uncertainty: UncertaintySection = Field(
        default=UncertaintySection(), exclude_if=lambda stated: stated == UncertaintySection()
    )

    @property
    def moves_real_hardware(self) -> bool:
        """True when an arm that is not started by this program would move."""
        return self.robot.is_real

    @property
    def has_emulated_devices(self) -> bool:
        """True when this program starts a stand-in for any of the three devices."""
        return any(device.is_emulated for device in self._devices)

    @property
    def is_imported(self) -> bool:
        """True of a run that others recorded."""
        return self.camera.is_imported

    @property
    def _devices(self) -> tuple[DeviceSection, ...]:
        return self.robot, self.force_sensor, self.camera


DEPTH_ERROR_M = {RobotModel.E_SERIES: 20e-6, RobotModel.CB3: 30e-6}
"""Difference of two heights within a millimetre: below the repeatability that the data sheets give
for coming back from anywhere, 30 um and 100 um. Likely, not measured."""
LAG_S = 0.05
"""Between a height and the force that belongs to it; times the press's speed it is a depth."""
REFINE_RATIO = 5.0
"""How many times slower than ``robot.search_speed`` the gel is met the second time."""
MOUNTING_TILT_RAD = math.radians(2.0)
"""How far an indenter's face may lean against the gel: what is seen by eye while mounting it."""
_UNIFORM = 1.0 / math.sqrt(3.0)
_FINE_M = ((6e-3, 0.05e-3), (30e-3, 0.1e-3), (120e-3, 0.15e-3))
"""ISO 2768-1, class f: up to this diameter [m], so much either way [m]."""
_FILLET_SHARE, _SHARP_M = 0.5, 0.05e-3
_FRICTION, _PLACE_M, _SCALE = 0.2, 0.3e-3, 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """A standard uncertainty, SI, and where it is from."""

    value: float
    source: str


def stated_uncertainty(config: RigConfig, field: str) -> Stated:
    """Return what a configuration states of one field of ``[uncertainty]``, or its default."""
    given: float | None = getattr(config.uncertainty, field)
    if given is not None:
        return Stated(value=given, source=f"uncertainty.{field} of rig.toml")
    fillet_m, diameter_m = config.indenter.fillet, config.indenter.diameter
    fine_m = next(half_m for most_m, half_m in _FINE_M if diameter_m <= most_m)
    defaults = {
        "diameter": (_UNIFORM * fine_m, f"default: ISO 2768-1 f, +-{fine_m * 1e3:g} mm"),
        "fillet": (_UNIFORM * _FILLET_SHARE * fillet_m, "default: half of it either way")
        if fillet_m
        else (_UNIFORM * _SHARP_M, "default: an edge that is broken by up to 0.05 mm"),
        "friction": (_FRICTION, "default: silicone on metal or plastic, assumed"),
        "tilt": (_UNIFORM * MOUNTING_TILT_RAD, "default: 2 deg are seen by eye while mounting"),
        "offset": (_PLACE_M, "default: a tool's centre and a gel's found by eye and ruler"),
        "depth": (
            DEPTH_ERROR_M[config.robot.model],
            "default: two heights within a millimetre, likely, not measured",
        ),
        "force_scale": (_SCALE, "default: 1 % of the reading, as sheets of such cells have it"),
        "delay": (_UNIFORM * LAG_S, "default: 50 ms between a height and its force at most"),
    }
    value, source = defaults[field]
    return Stated(value=value, source=source)
