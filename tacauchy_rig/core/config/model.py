"""What ``rig.toml`` may say. Values are SI; the file writes them as text with units."""

from __future__ import annotations

from enum import StrEnum
from typing import Self

from pydantic import Field, model_validator

from tacauchy_rig.core.config.fields import (
    CEILINGS,
    Angle,
    Force,
    ForceRate,
    Frequency,
    Length,
    Pressure,
    Ratio,
    Section,
    Time,
    Torque,
)
from tacauchy_rig.core.config.model import (
    CameraSection,
    DeviceSection,
    ForceSensorSection,
    RobotSection,
)
from tacauchy_rig.core.config.uncertainty import UncertaintySection


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


class SensorSection(Section):
    """The tactile sensor, and where its gel lies in the robot's base frame.

    ``name`` is a built-in sensor or the path of a TOML file; ``optics_calibration`` is what
    ``calibrate optics`` wrote, or empty where an emulated sensor is calibrated by itself.
    ``surface`` is the highest point of the unloaded gel (x, y, z); x and y are aimed at, z is only
    expected: contact is found by force.
    """

    ceilings = CEILINGS["sensor"]

    name: str
    optics_calibration: str
    surface: tuple[Length, Length, Length]
    surface_uncertainty: Length = Field(gt=0)


class WorkspaceSection(Section):
    """Box in the base frame that the tip never leaves, and how far the tool may tilt."""

    ceilings = CEILINGS["workspace"]

    x_min: Length
    x_max: Length
    y_min: Length
    y_max: Length
    z_min: Length
    z_max: Length
    max_tilt: Angle = Field(gt=0)
    home_radius: Length = Field(gt=0)


class LimitsSection(Section):
    """Limits of the guard, compared with every force sample and every state of the arm.

    An arm that covers less than a quarter of its commanded travel for ``no_motion`` is stopped.
    ``allow_unchecked_force`` lets an arm that hardly feels press by a cell that no weight checked.
    """

    ceilings = CEILINGS["limits"]

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


class ProtocolSection(Section):
    """The six presses: targets, tolerances, windows and gates.

    After its dwell a press sways up and down for ``sway``, which tells how late the streams are.
    """

    ceilings = CEILINGS["protocol"]

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


class ReplaySection(Section):
    """How trials are replayed: model settings that override the sensor's file.

    ``preset`` ``auto`` is the cheapest that promises F_z within 3 %, or ``balanced`` where none
    does. ``tolerance``, such as ``0.02N`` or ``1%``, chooses in place of ``preset``. With
    ``modulus`` ``depths`` the stated modulus, of all layers, is multiplied by what makes the
    simulated forces at the run's measured depths agree with the measured ones; ``young`` is taken
    as it is. ``law`` is the gel's constitutive law, ``friction`` Coulomb's coefficient between
    indenter and gel; with ``relaxation`` a gel relaxes if its file says how. ``indenter``, as
    ``press --indenter`` has it, takes the place of ``[indenter]``: ``mesh:tool.stl,unit=mm`` is one
    of triangles. ``tilt`` is how far the indenter's axis leans towards x and y, ``offset`` where it
    comes down beside ``sensor.surface``; with ``pose`` ``found`` what moments and images tell takes
    their place.
    """

    ceilings = CEILINGS["replay"]

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


class ReportSection(Section):
    """What a replay must reach for the verdict; ``docs/explanation/verdict.md`` has the reasons."""

    ceilings = CEILINGS["report"]

    min_force_margin: Ratio = Field(ge=1)
    max_contact_residual: Ratio = Field(gt=0)
    max_contact_offset: Length = Field(gt=0)
    coverage_factor: Ratio = Field(gt=0)
    min_modulus_trials: int = Field(ge=2)
    max_force_mismatch: Force = Field(gt=0)


class EmulationSection(Section):
    """The emulated world, for every device whose driver is ``emulated``.

    ``friction`` is Coulomb's coefficient between indenter and gel; ``tilt``, how far the indenter's
    axis leans towards base x and y, takes the place of what the seed draws.
    """

    ceilings = CEILINGS["emulation"]

    seed: int = Field(ge=0)
    robot_host: str
    markers: bool = False
    friction: Ratio = Field(default=0.0, ge=0)
    tilt: tuple[Angle, Angle] | None = None
    faults: tuple[str, ...] = ()


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
    def is_simulated(self) -> bool:
        """True when any of the three devices is emulated or mocked."""
        return any(device.is_stand_in for device in self._devices)

    @property
    def is_imported(self) -> bool:
        """True of a run that others recorded."""
        return self.camera.is_imported

    @property
    def _devices(self) -> tuple[DeviceSection, ...]:
        return self.robot, self.force_sensor, self.camera
