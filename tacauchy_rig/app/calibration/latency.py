"""How late force and image are, from a press that sways: the shift of depth that explains them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.config.settings import RigConfig, SyncMode
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.run import FZ, Phase
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore

GRID_S = 1e-3  # spacing of the depth's even time grid: well below any delay of interest
EARLIEST_S, LATEST_S, STEP_S = -0.06, 0.3, 0.005
BLOCKS = 6
"""Parts that are fitted by themselves: their scatter is the uncertainty, whatever the noise is."""
MIN_SAMPLES_A_BLOCK = 25
STALE_MADS, STALE_PASSES = 3.5, 5
"""A sample off by so many times the spread of all shows another moment: a camera that came too
late repeats an older image. The spread is the scaled median of the absolute residuals, and the
limit that of Iglewicz and Hoaglin 1993."""
MIN_EXPLAINED = 0.5
"""Part of a signal's variance; with less of it explained nothing was seen of the motion."""
Series = tuple[FloatArray, FloatArray]
"""Times [s] and values, each of shape [n]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """How late a stream is."""

    delay_s: float  # later than the arm's state of the same moment; negative is earlier
    # Standard uncertainty, of the scatter between parts of the motion and of the depth's own times
    uncertainty_s: float
    # Part of the signal's variance that the shifted depth explains, where it is fresh
    explained: float
    sample_count: int  # samples that were used
    stale_count: int = 0  # samples that were left out: they do not follow the motion


def find_delay(
    depth: Series,
    signal: Series,
    *,
    name: str,
    depth_time_uncertainty_s: float = 0.0,
    relaxation_s: Sequence[float] = (),
) -> Delay:
    """Return how much later than the depth a signal is.

    Args:
        depth: Of the arm [m].
        signal: In any unit.
        depth_time_uncertainty_s: Standard uncertainty of the depth's own times [s].
        relaxation_s: Times of the branches that the gel may have [s].

    Raises:
        RecordError: Too few samples, or nothing of the motion in them.
    """
    path = _Path(depth, relaxation_s)
    time_s, value = signal
    inside = (time_s > path.start_s + LATEST_S) & (time_s < path.end_s + EARLIEST_S)
    time_s, value = time_s[inside], value[inside]
    if len(time_s) < BLOCKS * MIN_SAMPLES_A_BLOCK:
        raise RecordError(
            f"{name}: {len(time_s)} samples of a motion are too few for a delay",
            remedy="sway for longer: `tacauchy-rig calibrate latency --sway 20s`",
        )
    fresh = _fresh(path, time_s, value)
    stale_count = int(np.count_nonzero(~fresh))
    time_s, value = time_s[fresh], value[fresh]
    delay_s, left = _best(path, time_s, value)
    explained = 1.0 - left / max(float(np.var(value)) * len(value), 1e-300)
    if explained < MIN_EXPLAINED or not math.isfinite(explained):
        raise RecordError(
            f"{name}: the arm's motion explains {explained:.0%} of it, too little for a delay",
            remedy="press harder, or see whether the stream shows the contact at all",
        )
    blocks = np.array_split(np.arange(len(time_s)), BLOCKS)
    parts = [_best(path, time_s[block], value[block])[0] for block in blocks]
    scatter_s = float(np.std(parts, ddof=1)) / math.sqrt(BLOCKS)
    return Delay(
        delay_s=delay_s,
        uncertainty_s=math.hypot(scatter_s, depth_time_uncertainty_s),
        explained=explained,
        sample_count=len(time_s),
        stale_count=stale_count,
    )


class _Path:
    """The depth and what the gel remembers of it, at any time."""

    def __init__(self, depth: Series, relaxation_s: Sequence[float]) -> None:
        time_s, depth_m = depth
        self.start_s, self.end_s = float(time_s[0]), float(time_s[-1])
        self._grid_s = np.arange(self.start_s, self.end_s, GRID_S)
        even = np.interp(self._grid_s, time_s, depth_m)
        even = (even - even.mean()) / max(float(np.ptp(even)), 1e-12)
        rise = np.diff(even, prepend=even[0])
        remembered = [lfilter([1.0], [1.0, -math.exp(-GRID_S / T)], rise) for T in relaxation_s]
        self._columns = [even, even**2, *remembered]

    def terms(self, time_s: FloatArray, delay_s: float) -> FloatArray:
        """Return what a signal that is so much later is linear in, shape [n, terms]."""
        drift = (time_s - time_s.mean()) / max(float(np.ptp(time_s)), 1e-12)
        shifted = [np.interp(time_s - delay_s, self._grid_s, each) for each in self._columns]
        return np.column_stack([np.ones_like(drift), drift, *shifted])


def _fresh(path: _Path, time_s: FloatArray, value: FloatArray) -> BoolArray:
    """Return which samples show the moment that their stamps say, as the others do."""
    fresh = np.ones(len(value), dtype=bool)
    for _ in range(STALE_PASSES):
        delay_s, _ = _best(path, time_s[fresh], value[fresh])
        terms = path.terms(time_s, delay_s)
        weights = np.linalg.lstsq(terms[fresh], value[fresh], rcond=None)[0]
        off = np.abs(value - terms @ weights)
        follows = off <= STALE_MADS * 1.4826 * float(np.median(off[fresh]))
        if np.array_equal(follows, fresh):
            break
        fresh = follows
    return fresh


def _best(path: _Path, time_s: FloatArray, value: FloatArray) -> tuple[float, float]:
    """Return the delay [s] that leaves least unexplained, and the sum of squares that it leaves."""

    def left(delay_s: float) -> float:
        terms = path.terms(time_s, delay_s)
        weights = np.linalg.lstsq(terms, value, rcond=None)[0]
        return float(np.sum((value - terms @ weights) ** 2))

    tried = np.arange(EARLIEST_S, LATEST_S, STEP_S)
    first = float(tried[int(np.argmin([left(float(each)) for each in tried]))])
    found = minimize_scalar(left, bounds=(first - STEP_S, first + STEP_S), method="bounded")
    return float(found.x), float(found.fun)


def even_stamps(stamp_ns: Int64Array, counter: FloatArray, *, share: float = 0.5) -> FloatArray:
    """Return when samples of an even stream were stamped [s], without the jitter of single ones.

    A busy host reads late now and then: a line through the stamps over the counter, moved to their
    median, is when a sample is stamped as a rule.

    Args:
        counter: The device's own count or clock, rising.
        share: Of the stamps that are earlier than what is returned; 0.5 is the median.
    """
    seconds = (stamp_ns - stamp_ns[0]) * 1e-9
    line = np.polyfit(counter - counter[0], seconds, 1)
    even = np.polyval(line, counter - counter[0])
    return np.asarray(even + np.quantile(seconds - even, share) + stamp_ns[0] * 1e-9)


RELAXATION_S = (0.3, 3.0)
"""Silicone gels creep over decades of time; terms of a second and a tenth can be separated from a
delay."""
SETTLING_S = 1.0
"""Left out at the beginning: a motion has to be under way for a gel to remember it evenly."""
EARLY_SHARE = 0.05
"""Of stamps: the control loop reads states up to 5 ms after they came, and a busy host reads
anything late now and then. What came early says when a device sends."""
WIDTH_PX = 80  # to which a frame is reduced: a contact is seen in it, and noise is averaged away
BORDER_SHARE = 0.2
"""Of width and height, on each side: the contact is in the middle, housing or counters beside."""
TRIGGER_FRAMES = 0.25
"""By how much of a frame's interval image and force may differ under a trigger."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Delays of one press against its arm."""

    force: Delay  # of the force sensor's stamps
    image: Delay  # of the camera's stamps
    sync_mode: SyncMode  # what the configuration declares of it
    # Why a declared trigger is not believed; empty where it is, or none is declared
    trigger_missed: str


def find_latency(store: RunStore) -> Latency:
    """Return the delays by the last press of a run that swayed.

    Raises:
        RecordError: No press swayed, or the streams show too little of it.
    """
    trial, attempt, start_ns, end_ns = _last_sway(store)
    recording = Recording.open(store.paths.recording(trial, attempt))
    arm, force = recording.arm, recording.force
    swayed = slice(*np.searchsorted(arm.stamp_ns, (start_ns, end_ns)))
    arm_s = even_stamps(arm.stamp_ns[swayed], arm.controller_time_s[swayed], share=EARLY_SHARE)
    depth = (arm_s, -arm.pose[swayed, 2])
    felt = slice(*np.searchsorted(force.stamp_ns, (start_ns, end_ns)))
    counter = force.counter[felt].astype(np.float64)
    force_s = even_stamps(force.stamp_ns[felt], counter, share=EARLY_SHARE)
    pressing = store.config.force_sensor.compression_sign * force.wrench[felt, FZ]
    # A state is as old as the controller's cycle at most when it is sent: a uniform distribution.
    of_depth_s = 1.0 / store.config.robot.model.rate_hz / math.sqrt(12.0)
    found = partial(find_delay, depth, depth_time_uncertainty_s=of_depth_s)
    late = found((force_s, pressing), name="force", relaxation_s=RELAXATION_S)
    seen = found(_image_signal(recording, start_ns, end_ns), name="image")
    return Latency(
        force=late,
        image=seen,
        sync_mode=store.config.run.sync_mode,
        trigger_missed=trigger_missed(store.config, late, seen),
    )


def _last_sway(store: RunStore) -> tuple[int, int, int, int]:
    """Return trial, attempt, start and end [ns] of the last sway that went to its end."""
    begun: tuple[int, int, int] | None = None
    whole: tuple[int, int, int, int] | None = None
    for event in Journal.read(store.paths.journal).events:
        if event.name != "phase":
            continue
        if event.detail.get("phase") == Phase.SWAY:
            begun = event.trial, event.attempt, event.stamp_ns + round(SETTLING_S * 1e9)
        elif begun is not None:
            if event.detail.get("phase") == Phase.RETRACT:
                whole = *begun, event.stamp_ns
            begun = None
    if whole is None:
        raise RecordError(
            f"{store.paths.root}: no press swayed to its end",
            remedy="`tacauchy-rig calibrate latency rig.toml` makes one that does",
        )
    return whole


def _image_signal(recording: Recording, start_ns: int, end_ns: int) -> Series:
    """Return stamps [s] and how far the motion is seen in the frames, in grey levels.

    The first principal component of the frames is what changes most in them: the contact.
    """
    frames, rows = [], []
    for frame in recording.frames(start_ns, end_ns):
        image = decode_rgb(frame.jpeg)
        if image is None:
            continue
        top, left = (round(BORDER_SHARE * length) for length in image.shape[:2])
        middle = np.ascontiguousarray(image[top:-top, left:-left])
        height = max(1, round(middle.shape[0] * WIDTH_PX / middle.shape[1]))
        small = cv2.resize(middle, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        frames.append((frame.stamp_ns, frame.counter))
        rows.append(small.astype(np.float64).ravel())
    if len(rows) < 2:
        return np.zeros(0), np.zeros(0)
    table = np.array(rows)
    table -= table.mean(axis=0)
    u, s, _ = np.linalg.svd(table, full_matrices=False)
    stamps, counters = np.array(frames, dtype=np.int64).T
    return even_stamps(stamps, counters.astype(np.float64), share=EARLY_SHARE), u[:, 0] * s[0]


def trigger_missed(config: RigConfig, force: Delay, image: Delay) -> str:
    """Say why a declared trigger is not believed; empty where it is, or where none is declared."""
    if config.run.sync_mode is not SyncMode.EXTERNAL_TRIGGER:
        return ""
    allowed_s = TRIGGER_FRAMES / config.camera.rate
    apart_s = image.delay_s - force.delay_s
    spread_s = 2.0 * math.hypot(image.uncertainty_s, force.uncertainty_s)
    if abs(apart_s) <= allowed_s + spread_s:
        return ""
    return (
        f"run.sync_mode is external_trigger, but images are stamped {apart_s * 1e3:+.1f} ms after "
        f"the force of the same moment, more than {allowed_s * 1e3:.1f} ms (a quarter of a frame)\n"
        "  -> see the trigger's cable and mode; or state the delays in rig.toml and "
        'sync_mode = "host_clock"'
    )
