"""What a report is made from: per trial the record, the replay, the images and the curves.

Images are RGB, cropped and resized as ``ImageGeometry`` says; all values are SI. Whatever is
missing is None: a run that broke off still gets a report that says so.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any, Self

from tacauchy_rig.core import run
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.config.settings import ReportSection, Stated
from tacauchy_rig.core.force_sensor_gain import ForceHistory
from tacauchy_rig.core.known_weight import ForceCheck
from tacauchy_rig.core.simulated import ForceDepthCurve, ReplayModel, ReplayTrial, model_of

PressKey = tuple[float, int, int]
"""Force [N], or zero and a number of its own, and the kind of a press."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageGeometry:
    """How a camera frame becomes the image that is scored."""

    crop_fraction: float = 0.15  # part of the width and height cut off at each border
    width_px: int = 320
    height_px: int = 240
    # Gel surface per pixel of the scored image [m/px]; None when not calibrated.
    scale_x_m_px: float | None = None
    scale_y_m_px: float | None = None  # the same along y; the two differ on real sensors [m/px]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialImages:
    """Images of one trial as the camera saw them; what is found in them can be kept beside."""

    real: ImageArray  # pixelwise median over the dwell
    reference: ImageArray  # pixelwise median of the no-contact frames taken before the press
    # Median over the first half of the dwell, for the noise ceiling; None below four frames.
    first_half: ImageArray | None = None
    second_half: ImageArray | None = None
    frame_count: int = 0  # frames in the dwell
    # By how much of the contact its first and its last third differ [1]; None when the dwell has
    # fewer than three frames.
    settled_change: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A signal over time, both of shape [n]; time [s] counts from the start of the dwell."""

    time_s: FloatArray
    value: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class IntermediateFrame:
    """What the camera showed at one force of a press."""

    image: ImageArray
    force_n: float | None  # measured then; None where nobody measured it
    depth_m: float | None  # the arm's, from where contact was felt; None likewise


@dataclass(frozen=True, slots=True, kw_only=True)
class IntermediateState:
    """A press at one force on its way, or at its end."""

    force_n: float  # simulated [N]; ``depth_m`` likewise, from first touch
    depth_m: float
    image: ImageArray  # simulated, shape [height, width, 3]
    dent_m: FloatArray  # how far the gel's surface is pushed in, shape [height, width]
    pressure_pa: FloatArray  # on the gel that lies where a pixel looks, same shape
    # The recorded frame nearest in force; None where none is near.
    frame: IntermediateFrame | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSummary:
    """Arrival of one stream's samples, measured from the recording."""

    name: str  # ``force``, ``image`` or ``arm``
    nominal_rate_hz: float | None  # what the configuration asks for; None when it does not say
    rate_hz: float  # samples over the time they took
    sample_count: int
    # Samples that the native counter shows and the recording lacks; None for a stream without a
    # counter.
    lost_count: int | None
    interval_median_ms: float
    interval_p99_ms: float  # 99th percentile of the time between arrivals [ms]
    interval_max_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthComparison:
    """One quantity of the emulated world beside what the pipeline made of it."""

    name: str
    true: float
    recovered: float
    unit: str
    trial: int = 0  # trial it belongs to; 0 for the whole run


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedWorld:
    """What only a report may know of a dry run."""

    values: dict[str, Any]  # content of ``truth.json``, units in the keys
    surface_expected_m: float  # height of the gel that the configuration expects [m]
    # True mean force [N] and depth [m] by trial, where the emulator's trace has them.
    dwells: dict[int, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialEvidence:
    """All that is known of one press."""

    index: int
    # What was asked for; of an imported press what was measured, which names it, or NaN.
    force_target_n: float
    # Forces that differ by no more are no wrong ones for each other: measured ones are never equal.
    force_tolerance_n: float = 0.0
    record: run.TrialRecord | None = None
    replay: ReplayTrial | None = None
    images: TrialImages | None = None
    # The replay's rendered image in the scored geometry, rendered over this trial's own no-contact
    # frame ``images.reference``.
    simulated_image: ImageArray | None = None
    force_curve: Curve | None = None  # tared pressing force [N], positive in compression
    depth_curve: Curve | None = None  # travel below the height of first contact [m]
    # Start and end of the window that counts, on the curves' time axis [s].
    dwell_s: tuple[float, float] | None = None
    # What files, hashes and raw samples of the attempt say of ``record``.
    checks: tuple[run.Criterion, ...] = ()
    # Of the simulator with the modulus that is stated.
    force_depth_simulated: ForceDepthCurve | None = None
    streams: tuple[StreamSummary, ...] = ()
    # It is known where on the pad was pressed; not so of many that are imported.
    place_known: bool = True
    # Equilibria up to its force, ascending; empty where no replay kept them.
    intermediate: tuple[IntermediateState, ...] = ()
    # Equal for presses of one indenter at one place: only those are compared with one another.
    kind: int = 0

    @property
    def force_measured_n(self) -> float | None:
        """Mean force in the dwell [N]; None where it is not recorded."""
        return None if self.record is None else self.record.force_measured_n

    @property
    def depth_measured_m(self) -> float | None:
        """Mean depth in the dwell [m], likewise."""
        return None if self.record is None else self.record.depth_measured_m

    @property
    def press_key(self) -> PressKey:
        """Equal for presses to one force; one whose force is not known is like no other."""
        unknown = math.isnan(self.force_target_n)
        force_n, number = (0.0, self.index) if unknown else (self.force_target_n, 0)
        return force_n, number, self.kind

    def is_wrong_for(self, other: Self) -> bool:
        """Return whether it was pressed to another force, all else alike."""
        is_near = abs(self.force_target_n - other.force_target_n) <= self.force_tolerance_n
        return self.kind == other.kind and self.press_key != other.press_key and not is_near


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalSummary:
    """What the journal of the run counts: attempts, faults, aborts and resumptions."""

    attempt_count: int = 0
    fault_count: int = 0
    abort_count: int = 0
    resume_count: int = 0
    faults: tuple[str, ...] = ()


def camera_of(provenance: Mapping[str, Any], *, simulated: bool) -> str:
    """Say whose images a run has: of a ``real`` camera, an ``emulated`` one, or ``imported``.

    Args:
        provenance: Of the run; its ``devices`` say what the camera was, ``imported`` that nobody
            here knows, unless its source says that it is simulated.
        simulated: What counts where they do not say.
    """
    if provenance.get("imported"):
        return "emulated" if simulated else "imported"
    camera = provenance.get("devices", {}).get("camera", {})
    return "emulated" if camera.get("simulated", simulated) else "real"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvidence:
    """A whole run and its replay."""

    # One for each press that the configuration asks for, in order, recorded or not.
    trials: tuple[TrialEvidence, ...]
    simulated: bool  # true when any device was emulated
    thresholds: ReportSection
    geometry: ImageGeometry = field(default_factory=ImageGeometry)
    # ``versions``, ``config_hash``, ``seed``, ``name``, ``created``, ``devices`` and whatever else
    # says where the numbers come from; plain JSON values.
    provenance: dict[str, Any] = field(default_factory=dict)
    journal: JournalSummary = field(default_factory=JournalSummary)
    # Force at which a press counts as contact [N]; depth counts from there.
    contact_force_n: float = 0.0
    # Standard uncertainties of cell, heights and delays by the fields of ``[uncertainty]``;
    # ``search_speed`` [m/s] and ``contact_force`` [N], as they are.
    stated: Mapping[str, Stated] = field(default_factory=dict)
    model: ReplayModel | None = None  # what was replayed; None where nothing was
    others: tuple[ReplayModel, ...] = ()  # the same of further indenters and places
    sync_mode: str = "host_clock"  # what ties force and images together in time (``run.sync_mode``)
    # How the cell read a known weight before the run; None where none was hung.
    force_check: ForceCheck | None = None
    # What all trials together say about the force sensor.
    force_history: ForceHistory = field(default_factory=lambda: ForceHistory(trials=(), sources=()))
    # A known weight was hung on the cell after the last trial, and it was right.
    weighed_after: bool = False
    # Whether it may press without such a check whatever its arm feels.
    unchecked_allowed: bool = False
    # The emulated world of a dry run; comparisons with it are made by ``compare``.
    world: EmulatedWorld | None = None
    checks: tuple[run.Criterion, ...] = ()  # what journal, description and replay say of each other
    imported: run.Imported | None = None  # where the run is from, if others recorded it
    # What its presses gave when optics were calibrated from them.
    optics: run.CalibratedOptics | None = None
    optics_picture: bytes = b""  # of each of its presses, real, rendered and apart, as PNG
    # What is no fault and has to be known of how the run was recorded, in sentences.
    notes: tuple[str, ...] = ()

    def model_of(self, trial: int) -> ReplayModel | None:
        """Return what a trial was pressed with."""
        return None if self.model is None else model_of((self.model, *self.others), trial)

    @property
    def drawn(self) -> Self:
        """Without the states on the way, which only the page shows: most of the memory."""
        trials = tuple(replace(trial, intermediate=()) for trial in self.trials)
        return replace(self, trials=trials)

    @property
    def optics_are_in_sample(self) -> bool:
        """The replay used optics that were fitted to the run's own presses, told by their content.

        Calibration files from before they named it: by the folder that a run was imported from.
        """
        optics = {} if self.model is None else self.model.optics
        files = {} if self.imported is None else self.imported.files
        if run.IMAGES_SHA256 in optics:
            seen = [trial.images.real for trial in self.trials if trial.images is not None]
            own = {sha256(image.tobytes()).hexdigest() for image in seen} | set(files.values())
            return not own.isdisjoint(optics[run.IMAGES_SHA256])
        folder = "" if self.imported is None else f" ball presses in {self.imported.source}"
        return bool(folder) and str(optics.get("source", "")).endswith(folder)

    @property
    def marks(self) -> tuple[str, ...]:
        """What every page and figure has to say of where its numbers are from."""
        imported = () if self.imported is None else (run.IMPORTED_MARK,)
        return (*imported, run.SIMULATED_MARK) if self.simulated else imported

    @property
    def camera(self) -> str:
        """``real``, ``emulated`` or ``imported``: whose images the trials have."""
        return camera_of(self.provenance, simulated=self.simulated)
