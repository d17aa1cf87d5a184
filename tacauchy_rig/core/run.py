"""What was asked and what happened in a run: the types that folders exchange.

Drivers, protocols, sim and reports never import one another; they meet in these types, in those of
``tacauchy_rig.core.simulated``, and in the run folder that ``tacauchy_rig.core.store`` reads and
writes. All values are SI.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Literal, Self

from tacauchy_rig.core.quantities import FREE

SIMULATED_MARK = "SIMULATED: emulated devices"
IMPORTED_MARK = "IMPORTED: recorded elsewhere"

Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]


def vector6(values: Iterable[float]) -> Vector6:
    """Return six numbers as a tuple of a known length."""
    a, b, c, d, e, f = values
    return (a, b, c, d, e, f)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Pose of the indenter's tip in the robot's base frame.

    Attributes:
        position: x, y, z [m]; z points up, away from the gel.
        rotation_vector: Axis times angle [rad], as UR controllers report it.
    """

    position: Vector3
    rotation_vector: Vector3

    @classmethod
    def of(cls, vector: Iterable[float]) -> Self:
        """Return the pose of ``(x, y, z, rx, ry, rz)`` [m, rad]."""
        six = vector6(vector)
        return cls(position=six[:3], rotation_vector=six[3:])

    def as_vector(self) -> Vector6:
        """Return ``(x, y, z, rx, ry, rz)`` [m, rad]."""
        return (*self.position, *self.rotation_vector)

    def shifted(self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Self:
        """Return the pose moved by (x, y, z) [m] with the same orientation."""
        px, py, pz = self.position
        return replace(self, position=(px + x, py + y, pz + z))


FZ = 2
"""Where the force along the sensor's axis stands in a wrench."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceSample:
    """One frame of the force sensor, raw: no tare, no sign, no filter.

    Attributes:
        stamp_ns: ``time.monotonic_ns`` of this host at arrival.
        counter: The box's package number, unwrapped: a gap is a lost frame.
        wrench: Fx, Fy, Fz [N], Mx, My, Mz [N m] in the sensor's frame, as it reports them.
    """

    stamp_ns: int
    counter: int
    wrench: Vector6


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
        tcp_force: What the arm itself takes for force [N] and moment [N m] on its tool, axes of the
            base frame, not tared; None where it has no such estimate. Of UR's controllers this is
            RTDE's actual_TCP_force: a pressed tool is pushed up, +Fz. UR's guide does not state the
            sign: ``robot.force_sign`` is -1 where it is the other. An e-Series arm may refer the
            moments to its flange.
    """

    stamp_ns: int
    controller_time_s: float
    pose: Pose
    velocity: Vector6
    runtime_state: int
    safety_bits: int
    robot_mode: int
    tcp_force: Vector6 | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFrame:
    """One compressed camera image, exactly as the camera sent it or an imported file holds it.

    Attributes:
        stamp_ns: ``time.monotonic_ns`` of this host at arrival.
        counter: Frames read since the camera was started.
        device_stamp_s: The driver's own stamp [s], or None where it has none worth keeping.
        jpeg: The untouched JPEG bytes; PNG of a source that has those.
    """

    stamp_ns: int
    counter: int
    device_stamp_s: float | None
    width: int
    height: int
    jpeg: bytes

    @property
    def kind(self) -> str:
        """What its bytes are: ``png`` or ``jpeg``."""
        return "png" if self.jpeg.startswith(b"\x89PNG") else "jpeg"


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
    SWAY = "sway"
    RETRACT = "retract"
    DRIFT_CHECK = "drift-check"
    VERDICT = "verdict"
    FAULT = "fault"


class Outcome(StrEnum):
    """How an attempt ended; ``imported`` is none of ours: no protocol watched it."""

    PASSED = "passed"
    FAILED = "failed"
    FAULT = "fault"
    ABORTED = "aborted"
    IMPORTED = "imported"


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """One checked number.

    Attributes:
        name: For example ``force_mean``.
        measured: Value in ``unit``; ``limit`` says what it had to satisfy, in words and numbers.
            NaN or infinite where nothing could be measured, or divided by.
        remedy: What to do; one that is met needs none.
    """

    name: str
    passed: bool
    measured: float = field(metadata={FREE: True})
    limit: str
    unit: str
    remedy: str = ""

    def __post_init__(self) -> None:
        if self.passed:
            object.__setattr__(self, "remedy", "")

    @classmethod
    def at_most(
        cls, name: str, measured: float, limit: float, *, unit: str = "", remedy: str
    ) -> Self:
        """Return whether ``measured`` is no larger than ``limit``."""
        told, passed = f"<= {limit:g} {unit}".strip(), measured <= limit
        return cls(
            name=name, measured=measured, passed=passed, limit=told, unit=unit, remedy=remedy
        )

    @classmethod
    def at_least(cls, name: str, measured: float, limit: float, *, unit: str, remedy: str) -> Self:
        """Return whether ``measured`` is no smaller than ``limit``."""
        told, passed = f">= {limit:g} {unit}", measured >= limit
        return cls(
            name=name, measured=measured, passed=passed, limit=told, unit=unit, remedy=remedy
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
        force_target_n: What the press was to reach [N]; NaN where nobody of ours asked for a force.
        force_measured_n: Mean pressing force over the dwell [N], tared, positive in compression.
        force_deviation_n: Standard deviation of that force over the dwell [N].
        force_drift_n: Unloaded force after minus before [N].
        contact_z_m: Tip height at which contact was found, in the robot's base frame.
        depth_measured_m: Travel below ``contact_z_m`` averaged over the dwell.
        arm_force_n: Mean force over the dwell as the arm itself felt it [N], less what it felt
            above the gel; None where it has no estimate.
        force_expected_n: Least and most force of the stated gel at that depth [N]; None where
            nothing was expected.
        press_depth_m: Depths below contact at which the force was kept on the way to the target.
        press_force_n: Force at each of ``press_depth_m`` [N].
        limit: What cut the attempt off, by its name; empty where nothing did.
        dwell_start_ns: First and last arrival stamp of the window that counts.
        reference_start_ns: Window of no-contact frames taken before the press.
        rates: Achieved rates, losses and latencies (keys carry their unit, such as
            ``force_rate_hz``, ``force_lost_count``, ``image_rate_hz``, ``image_gap_max_ms``).
        recording_sha256: Of ``recording.mcap`` as it was closed; None where it never was.
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
    arm_force_n: float | None = None
    force_expected_n: tuple[float, float] | None = None
    press_depth_m: tuple[float, ...] = ()
    press_force_n: tuple[float, ...] = ()
    limit: str = ""
    tare_before: Tare | None = None
    tare_after: Tare | None = None
    dwell_start_ns: int | None = None
    dwell_end_ns: int | None = None
    reference_start_ns: int | None = None
    reference_end_ns: int | None = None
    criteria: tuple[Criterion, ...] = ()
    rates: dict[str, float] = field(default_factory=dict)
    recording_sha256: str | None = None

    @property
    def passed(self) -> bool:
        """True when the attempt ran to its end and met every criterion."""
        return self.outcome is Outcome.PASSED

    @property
    def windows(self) -> dict[str, tuple[int, int]]:
        """First and last stamp [ns] of ``tare``, ``reference`` and ``dwell``, as far as known."""
        tare = self.tare_before
        found = {
            "tare": (None, None) if tare is None else (tare.start_ns, tare.end_ns),
            "reference": (self.reference_start_ns, self.reference_end_ns),
            "dwell": (self.dwell_start_ns, self.dwell_end_ns),
        }
        return {k: (a, b) for k, (a, b) in found.items() if a is not None and b is not None}

    def doubted(self, criterion: Criterion) -> Self:
        """Return the record of an attempt that missed ``criterion`` in hindsight."""
        outcome = Outcome.FAILED if self.passed else self.outcome
        criteria = (*(c for c in self.criteria if c.name != criterion.name), criterion)
        return replace(self, outcome=outcome, reason=criterion.remedy, criteria=criteria)


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalEvent:
    """One line of ``journal.jsonl``.

    Attributes:
        name: ``phase``, ``attempt-start``, ``attempt-end``, ``attempt-repeated``,
            ``fault``, ``abort``, ``process-died``, ``force-check``, ``resume-set``, ``resume``,
            ``run-start``, ``run-end``; and of the run
            folder itself ``written``, ``sealed``, ``recovered``, ``cut-off`` and ``replayed``.
        detail: Plain JSON values, units in the keys.
    """

    stamp_ns: int
    name: str
    trial: int = 0
    attempt: int = 0
    detail: dict[str, Any] = field(default_factory=dict, metadata={FREE: True})

    @classmethod
    def now(cls, name: str, **detail: Any) -> Self:
        """Return an event of this moment that belongs to no attempt."""
        return cls(stamp_ns=time.monotonic_ns(), name=name, detail=detail)


SAME_PLACE_M = 3e-5
"""Presses nearer to each other are at one place: half a pixel of a GelSight Mini."""


Stream = Literal["force", "arm", "image"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedTrial:
    """One press of theirs.

    Attributes:
        name: What the source calls it.
        place_m: Where the indenter's tip came down beside the pad's centre [m]; None: not known.
        indenter: As ``press --indenter`` has it; empty is the run's.
        streams: Those that its recording has.
        contact_px: Column, row and radius of the contact's edge as somebody drew it into the
            image, in its own pixels [px]; None where nobody did.
        image: What the source calls its last image; empty where it has none.
    """

    index: int
    name: str
    place_m: tuple[float, float] | None = None
    indenter: str = ""
    streams: tuple[Stream, ...] = ()
    contact_px: tuple[float, float, float] | None = None
    image: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraClock:
    """How images were aligned in time with the force.

    Attributes:
        offset_s: Added to the camera's time of the first image for the log's own time [s].
        uncertainty_s: Its standard uncertainty, and that of later ones [s].
        correlation: Of what is seen with what is felt, with this offset.
        drift: Growth of the offset from there [s a second of the camera].
    """

    offset_s: float
    uncertainty_s: float
    correlation: float
    drift: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """Where an imported run is from.

    Attributes:
        kind: Its format, such as ``csv``.
        source: Name of the folder or file.
        has_clock: Samples have times of theirs; without, stamps give the order only.
        unknown: What the source does not say, a sentence each.
        notes: What was made of it, a sentence each: losses, and how presses were found.
        files: SHA-256 of what was read, by the name within the source.
        clock: None where no camera's clock was aligned.
    """

    kind: str
    source: str
    has_clock: bool
    unknown: tuple[str, ...]
    notes: tuple[str, ...]
    trials: tuple[ImportedTrial, ...]
    files: dict[str, str] = field(default_factory=dict)
    clock: CameraClock | None = None


IMAGES_SHA256 = "images_sha256"
"""Of a calibration file: SHA-256 of each press that it was fitted to, of pixels and of its file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageAgreement:
    """Presses rendered by a model that had not seen them, beside the no-contact frame.

    Attributes:
        r2: Share of the variance of the colour change explained inside the contacts.
        mae_levels: Mean absolute error inside the contacts [grey levels].
        ssim: Of a square around each contact, mean over presses.
    """

    r2: float
    mae_levels: float
    ssim: float
    r2_no_contact: float
    mae_no_contact_levels: float
    ssim_no_contact: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutPress:
    """One press as the other folds' model renders it; its image lies beside the calibration.

    Attributes:
        contact_px: Column, row and radius of its contact as labelled or found [px].
        nudged_px: By how much the image has them elsewhere [px].
        mae_levels: Mean absolute error inside the contact [grey levels].
    """

    trial: int
    contact_px: tuple[float, float, float]
    nudged_px: tuple[float, float, float]
    mae_levels: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedOptics:
    """A calibration from a run's own presses, cross-validated.

    Attributes:
        labelled: Contacts were drawn by somebody; otherwise they were found in the images.
        scale_px_m: Pixels per metre along columns and rows, as stated.
        crop_px: Side of the square that SSIM is of [px].
        nudged: Circles moved to where the image has them, in each frame's own light.
        as_labelled: Circles as labelled or found, in each frame's own light.
        no_contact_light: Circles as labelled or found, in the no-contact frame's light.
    """

    ball_diameter_m: float
    scale_px_m: tuple[float, float]
    sensor: str
    preset: str
    labelled: bool
    folds: int
    crop_px: int
    nudged: ImageAgreement
    as_labelled: ImageAgreement
    no_contact_light: ImageAgreement
    presses: tuple[HeldOutPress, ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedPress:
    """Force against depth of one indenter in one gel; ``expected.json`` of a run.

    Attributes:
        sensor: Whose gel, as its file names it.
        made: How the curve was made, and of what its uncertainty consists, in words.
        depth_m: Rising depths below first touch, from 0 [m].
        force_n: Rising force at each, pressed straight [N].
        low: What the true force may be over the curve's, at least [1].
        high: The same at most [1].
        lean_m: How far one edge of a flat face may come down before its middle, because the face
            leans against the gel [m]; 0 for a ball.
        depth_error_m: How far off the difference of two depths of one press may be [m].
        gel_height_m: Thickness of the gel under the indenter [m].
    """

    sensor: str
    made: str
    depth_m: tuple[float, ...]
    force_n: tuple[float, ...]
    low: float
    high: float
    lean_m: float
    depth_error_m: float
    gel_height_m: float
