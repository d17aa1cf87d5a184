"""What was asked, what happened and what was replayed: the types that folders exchange.

Drivers, protocols, sim and reports never import one another; they meet in these types and in
the run folder that ``tacauchy_rig.store`` reads and writes. All values are SI.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Pose of the indenter's tip in the robot's base frame.

    Attributes:
        position: x, y, z [m]; z points up, away from the gel.
        rotation_vector: Axis times angle [rad], as UR controllers report it.
    """

    position: Vector3
    rotation_vector: Vector3

    def as_vector(self) -> Vector6:
        """Return ``(x, y, z, rx, ry, rz)`` [m, rad]."""
        return (*self.position, *self.rotation_vector)

    def shifted(self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
        """Return the pose moved by (x, y, z) [m] with the same orientation."""
        px, py, pz = self.position
        return Pose(position=(px + x, py + y, pz + z), rotation_vector=self.rotation_vector)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrench:
    """Force [N] and moment [N m] in the force sensor's frame, as the sensor reports them."""

    force: Vector3
    torque: Vector3


FZ = 2
"""Where the force along the sensor's axis stands in a wrench."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceSample:
    """One frame of the force sensor, raw: no tare, no sign, no filter.

    Attributes:
        stamp_ns: ``time.monotonic_ns`` of this host at arrival.
        counter: The box's package number, unwrapped: a gap is a lost frame.
    """

    stamp_ns: int
    counter: int
    wrench: Wrench


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmSample:
    """One state of the arm.

    Attributes:
        stamp_ns: ``time.monotonic_ns`` of this host when the state was read.
        controller_time_s: The controller's own time stamp [s].
        velocity: Tool velocity [m/s, rad/s].
        runtime_state: RTDE runtime_state (2 playing).
        safety_bits: RTDE safety_status_bits.
        robot_mode: RTDE robot_mode (7 running).
    """

    stamp_ns: int
    controller_time_s: float
    pose: Pose
    velocity: Vector6
    runtime_state: int
    safety_bits: int
    robot_mode: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFrame:
    """One compressed camera image, exactly as the camera sent it.

    Attributes:
        stamp_ns: ``time.monotonic_ns`` of this host at arrival.
        counter: Frames read since the camera was started.
        device_stamp_s: The driver's own stamp [s], or None where it has none worth keeping.
        jpeg: The untouched JPEG bytes.
    """

    stamp_ns: int
    counter: int
    device_stamp_s: float | None
    width: int
    height: int
    jpeg: bytes


class Phase(StrEnum):
    """Where a trial is; every change is a line of the journal."""

    PREFLIGHT = "preflight"
    AIR_PRESS = "air-press"
    HOME = "home"
    TARE = "tare"
    REFERENCE = "reference"
    APPROACH = "approach"
    SEARCH = "search"
    PRESS = "press"
    DWELL = "dwell"
    RETRACT = "retract"
    DRIFT_CHECK = "drift-check"
    VERDICT = "verdict"
    FAULT = "fault"


class Outcome(StrEnum):
    """How an attempt ended."""

    PASSED = "passed"
    FAILED = "failed"
    FAULT = "fault"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """One checked number.

    Attributes:
        name: For example ``force_mean``.
        measured: Value in ``unit``; ``limit`` says what it had to satisfy, in words and numbers.
        remedy: What to do when it failed.
    """

    name: str
    passed: bool
    measured: float
    limit: str
    unit: str
    remedy: str = ""

    @classmethod
    def at_most(
        cls, name: str, measured: float, limit: float, *, unit: str = "", remedy: str
    ) -> Criterion:
        """Return whether ``measured`` is no larger than ``limit``."""
        return cls(
            name=name,
            passed=measured <= limit,
            measured=measured,
            limit=f"<= {limit:g} {unit}".strip(),
            unit=unit,
            remedy=remedy,
        )

    @classmethod
    def at_least(
        cls, name: str, measured: float, limit: float, *, unit: str, remedy: str
    ) -> Criterion:
        """Return whether ``measured`` is no smaller than ``limit``."""
        return cls(
            name=name,
            passed=measured >= limit,
            measured=measured,
            limit=f">= {limit:g} {unit}",
            unit=unit,
            remedy=remedy,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tare:
    """Mean raw wrench of an unloaded interval, the software zero of a trial.

    Attributes:
        mean: Fx, Fy, Fz [N], Mx, My, Mz [N m] as the sensor reports them.
        deviation: Standard deviation of each.
    """

    start_ns: int
    end_ns: int
    mean: Vector6
    deviation: Vector6
    sample_count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRecord:
    """What one attempt at a trial gave; ``result.json`` beside its recording.

    Attributes:
        force_measured_n: Mean pressing force over the dwell [N], tared, positive in compression.
        force_deviation_n: Standard deviation of that force over the dwell [N].
        force_drift_n: Unloaded force after minus before [N].
        contact_z_m: Tip height at which contact was found, in the robot's base frame.
        depth_measured_m: Travel below ``contact_z_m`` averaged over the dwell.
        dwell_start_ns: First and last arrival stamp of the window that counts.
        reference_start_ns: Window of no-contact frames taken before the press.
        rates: Achieved rates, losses and latencies (keys carry their unit, such as
            ``force_rate_hz``, ``force_lost_count``, ``image_rate_hz``, ``image_gap_max_ms``).
    """

    index: int
    attempt: int
    outcome: Outcome
    force_target_n: float
    reason: str = ""
    force_measured_n: float | None = None
    force_deviation_n: float | None = None
    force_rate_n_s: float | None = None
    force_drift_n: float | None = None
    contact_z_m: float | None = None
    depth_measured_m: float | None = None
    tare_before: Tare | None = None
    tare_after: Tare | None = None
    dwell_start_ns: int | None = None
    dwell_end_ns: int | None = None
    reference_start_ns: int | None = None
    reference_end_ns: int | None = None
    criteria: tuple[Criterion, ...] = ()
    rates: dict[str, float] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """True when the attempt ran to its end and met every criterion."""
        return self.outcome is Outcome.PASSED


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalEvent:
    """One line of ``journal.jsonl``.

    Attributes:
        name: ``phase``, ``attempt-start``, ``attempt-end``, ``fault``, ``abort``, ``process-died``,
            ``resume``, ``run-start``, ``run-end``.
        detail: Plain JSON values, units in the keys.
    """

    stamp_ns: int
    name: str
    trial: int = 0
    attempt: int = 0
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayTrial:
    """One trial as the simulator replayed it; fields and image lie beside it on disk.

    Attributes:
        force_simulated_n: Simulated pressing force at the accepted depth [N].
        force_history: (depth [m], force [N]) of every evaluation of the displacement search.
        force_error_estimate: Believed relative error of the simulated force, None where nothing
            is known; ``force_error_basis`` says how it is known.
    """

    index: int
    force_measured_n: float
    force_simulated_n: float
    depth_simulated_m: float
    force_error_estimate: float | None
    force_error_basis: str
    newton_iterations: int
    search_iterations: int
    wall_s: dict[str, float]
    balance_relative: float
    gap_min_m: float
    min_jacobian: float
    force_history: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Settings beside those that were used.

    Attributes:
        role: ``cheaper`` or ``better``.
        setting: A preset, or a mesh between two.
        error_relative: Believed relative error of F_z; None where nothing is known.
        time_ratio: Its time over that of the settings used.
        wall_s: The time it would have taken here [s]; None where nothing was pressed.
    """

    role: str
    setting: str
    error_relative: float | None
    time_ratio: float
    wall_s: float | None

    def __str__(self) -> str:
        error = "unknown" if self.error_relative is None else f"{self.error_relative:.1%}"
        seconds = "" if self.wall_s is None else f" ({_short(self.wall_s)} s)"
        time = f"about {_short(self.time_ratio)} times the time{seconds}"
        return f"preset {self.setting}: {time}, force error {error}"


def _short(value: float) -> str:
    """Return two significant digits, or whole numbers from 100 on."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayLayer:
    """One of the gel's layers; ``share`` is its part of the height."""

    share: float
    young_pa: float
    poisson: float


_LeftOut = Field(exclude_if=lambda value: value is None)
"""A key that is not written where there is nothing to say."""


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class MarkerMotion:
    """How the markers of a trial moved in the recording and in the simulator.

    Attributes:
        drawn: Markers in the rendered image.
        tracked: Markers found in both recorded frames; this and what follows is None where no
            frame of the dwell could be read.
        lost: Markers of the no-contact frame that were not found again.
        apart_rms_m: Of the recorded minus the simulated motion [m].
    """

    trial: int
    drawn: int
    tracked: Annotated[int | None, _LeftOut] = None
    lost: Annotated[int | None, _LeftOut] = None
    recorded_rms_m: Annotated[float | None, _LeftOut] = None
    recorded_largest_m: Annotated[float | None, _LeftOut] = None
    simulated_rms_m: Annotated[float | None, _LeftOut] = None
    simulated_largest_m: Annotated[float | None, _LeftOut] = None
    apart_rms_m: Annotated[float | None, _LeftOut] = None
    apart_largest_m: Annotated[float | None, _LeftOut] = None


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class ReplayModel:
    """What a run was replayed with, what that is worth, and what it cost.

    Attributes:
        centre_x_m: Where the indenter's tip came down, in the pad's frame [m].
        layers: From the clamped base upwards; empty for a gel of one material.
        preset: Mesh and element: a preset, or a mesh between two.
        barrier_m: Distance at which contact begins to push [m].
        setup_s: Time of meshing and assembling [s].
        tolerance: What chose the preset, in words; None where nothing did.
        force_error_largest_relative: Of the trials' believed errors; None where one is not known.
        wall_s: Time of the whole replay [s].
        effects: What was simulated and what was left out, with reasons.
        young_uncertainty_relative: Of the stated modulus; ``young_source`` says who states it.
        optics: Where the optics are from.
        scale_x_m_px: Gel surface per pixel of the rendered image [m/px].
        image_centre_m: Place that the image's middle sees, in the pad's frame [m].
        modulus_factor: What the stated modulus was multiplied by, as the run's depths say; this
            and its company is None where it was taken as stated.
        modulus_factor_deviation: Standard deviation of the trials' own factors.
        stated_force_history: (depth [m], force [N]) of the gel with the stated modulus.
        markers: Of each trial of a sensor with markers.
    """

    sensor: str
    indenter: str
    centre_x_m: float
    centre_y_m: float
    contact: str
    drive: str
    law: str
    young_pa: float
    poisson: float
    layers: tuple[ReplayLayer, ...]
    preset: str
    element: str
    element_is_linear: bool
    tet_count: int
    node_count: int
    mesh: str
    mesh_hash: str
    barrier_m: float
    linear_solver: str
    device: str
    setup_s: float
    tolerance: str | None
    force_error_largest_relative: float | None
    wall_s: float
    alternatives: tuple[Alternative, ...]
    effects: tuple[dict[str, Any], ...]
    young_uncertainty_relative: float | None = None
    young_source: str = ""
    optics: dict[str, Any] = field(default_factory=dict)
    scale_x_m_px: float | None = None
    image_centre_m: tuple[float, float] = (0.0, 0.0)
    scale_y_m_px: float | None = None
    modulus_factor: Annotated[float | None, _LeftOut] = None
    modulus_factor_deviation: Annotated[float | None, _LeftOut] = None
    modulus_trials: Annotated[int | None, _LeftOut] = None
    stated_force_history: Annotated[tuple[tuple[float, float], ...] | None, _LeftOut] = None
    markers: tuple[MarkerMotion, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """All trials of a run, replayed with one model."""

    name: str
    trials: tuple[ReplayTrial, ...]
    model: ReplayModel
    versions: dict[str, str]
