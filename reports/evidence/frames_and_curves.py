"""What is read of an attempt, each frame decoded once, and what a replay keeps of a press."""

import logging
import math
from collections.abc import Callable, Collection, Sequence
from copy import copy
from functools import cached_property
from typing import Self, TypeVar

import cv2
import numpy as np

from reports.evidence.evidence_types import Curve, ImageGeometry, StreamSummary, TrialImages
from tacauchy_rig.core.arrays import FloatArray, ImageArray, Int64Array
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.run import FZ, ImageFrame, TrialRecord
from tacauchy_rig.core.store.recording.mcap_reader import ForceArrays
from tacauchy_rig.core.store.run_store import RunStore

THIRDS = 3
ROUNDING_LEVELS = 1.0 / math.sqrt(12.0)
"""Of one frame to 8 bits: a contact that changes less than that does not show."""


def settled_change(pressed: Sequence[ImageArray], reference: ImageArray) -> float | None:
    """Return by how much of the contact first and last third of a dwell differ [1].

    Their difference is projected on the contact's own image, the mean of the dwell less the
    reference. Noise has no part in that image but by chance: of N values with a deviation s beside
    a contact c it leaves s / (c sqrt(N)), whether or not a camera repeats its noise.

    Of pictures that show one contact it is 0; None for fewer than three frames.
    """
    count = len(pressed) // THIRDS
    if count == 0:
        return None
    contact = _mean(pressed) - reference
    change = _mean(pressed[-count:]) - _mean(pressed[:count])
    strength = max(float(np.mean(contact**2)), ROUNDING_LEVELS**2)
    return abs(float(np.mean(change * contact))) / strength


def _mean(images: Sequence[ImageArray]) -> FloatArray:
    return np.asarray(np.mean(np.stack(images), axis=0, dtype=np.float64))


T = TypeVar("T")
Z = 2  # of a position
MIN_FRAMES_TO_SPLIT = 4
MIN_SAMPLES = 10  # of force in a dwell, for their scatter

logger = logging.getLogger(__name__)


class AttemptReading:
    """One attempt at a trial; what is asked for is read when it is first asked for, and kept.

    Raises:
        RecordError: The recording is missing or damaged.
    """

    def __init__(self, store: RunStore, record: TrialRecord, geometry: ImageGeometry) -> None:
        self.store = store
        self.record = record
        self.recording = store.recording(record.index, record.attempt)
        self.geometry = geometry
        # How much later than the arm's state of the same moment its samples are stamped.
        self._force_late_ns = round(store.config.force_sensor.delay * 1e9)
        self._camera_late_ns = round(store.config.camera.delay * 1e9)

    @property
    def force(self) -> ForceArrays:
        """The force stream, raw."""
        return self.recording.force

    @cached_property
    def reference(self) -> ImageArray | None:
        """Pixelwise median of the no-contact frames; None when none is readable."""
        start_ns, end_ns = self.record.reference_start_ns, self.record.reference_end_ns
        unloaded = self._frames(start_ns, end_ns, late_ns=self._camera_late_ns)
        return median_image(unloaded) if unloaded else None

    @cached_property
    def images(self) -> TrialImages | None:
        """Medians of the dwell beside the reference; None where either has no readable frame."""
        # A dwell begins and ends with force samples, which were stamped late themselves.
        late_ns = self._camera_late_ns - self._force_late_ns
        pressed = self._frames(
            self.record.dwell_start_ns, self.record.dwell_end_ns, late_ns=late_ns
        )
        if not pressed or self.reference is None:
            return None
        half = len(pressed) // 2
        split = len(pressed) >= MIN_FRAMES_TO_SPLIT
        return TrialImages(
            real=median_image(pressed),
            reference=self.reference,
            first_half=median_image(pressed[:half]) if split else None,
            second_half=median_image(pressed[half:]) if split else None,
            frame_count=len(pressed),
            settled_change=settled_change(pressed, self.reference),
        )

    @property
    def dwell_s(self) -> tuple[float, float] | None:
        """Start and end of the dwell on the time axis of the curves [s]."""
        start_ns, end_ns = self.record.dwell_start_ns, self.record.dwell_end_ns
        return None if start_ns is None or end_ns is None else (0.0, (end_ns - start_ns) * 1e-9)

    @property
    def force_curve(self) -> Curve | None:
        """The tared pressing force [N], positive in compression; None without a tare."""
        tare, sign = self.record.tare_before, self.store.config.force_sensor.compression_sign
        if tare is None:
            return None
        stamp_ns = self.force.stamp_ns - self._force_late_ns
        return self._curve(stamp_ns, sign * (self.force.wrench[:, FZ] - tare.mean[FZ]))

    @property
    def dwell_wrench(self) -> tuple[FloatArray, FloatArray] | None:
        """Mean tared wrench of the dwell in the cell's frame and its standard error, shape [6].

        None without a tare or a dwell, or where a component is not known.
        """
        record, tare = self.record, self.record.tare_before
        if tare is None:
            return None
        samples = self.force.between(record.dwell_start_ns, record.dwell_end_ns)
        if len(samples) < MIN_SAMPLES or not np.isfinite(samples).all():
            return None
        variance = samples.var(axis=0, ddof=1) / len(samples)
        variance += np.square(tare.deviation) / max(1, tare.sample_count)
        return samples.mean(axis=0) - np.array(tare.mean), np.sqrt(variance)

    @property
    def depth_curve(self) -> Curve | None:
        """The travel below the height of first contact [m]; None where nothing was touched."""
        contact_z_m = self.record.contact_z_m
        if contact_z_m is None:
            return None
        arm = self.recording.arm
        return self._curve(arm.stamp_ns, contact_z_m - arm.pose[:, Z])

    @property
    def frame_stamps(self) -> Curve:
        """The arrival stamps of all frames [ns], over when they were taken."""
        stamp_ns, _ = self.recording.frame_stamps()
        return self._curve(stamp_ns - self._camera_late_ns, stamp_ns.astype(np.float64))

    @property
    def press_duration_s(self) -> float | None:
        """Time from the first touch to the middle of the dwell [s]; None where one is not known."""
        curve, dwell = self.depth_curve, self.dwell_s
        if curve is None or dwell is None:
            return None
        touched = curve.time_s[(curve.value > 0.0) & (curve.time_s < dwell[0])]
        return 0.5 * sum(dwell) - float(touched[0]) if len(touched) else None

    @property
    def streams(self) -> tuple[StreamSummary, ...]:
        """How regularly the samples of each stream arrived, and how many are missing.

        Nothing of an imported run: its stamps are its source's, and its counters count its samples.
        """
        config, force = self.store.config, self.force
        if config.is_imported:
            return ()
        stamps, counters = self.recording.frame_stamps()
        found = (
            summarize_stream("force", force.stamp_ns, force.counter, config.force_sensor.rate),
            summarize_stream("image", stamps, counters, config.camera.rate),
            summarize_stream("arm", self.recording.arm.stamp_ns),
        )
        return tuple(stream for stream in found if stream is not None)

    def _frames(
        self, start_ns: int | None, end_ns: int | None, *, late_ns: int
    ) -> list[ImageArray]:
        """Return the images from ``start_ns`` to ``end_ns``, stamped ``late_ns`` later."""
        if start_ns is None or end_ns is None:
            return []
        decoded = map(decode_frame, self.recording.frames(start_ns + late_ns, end_ns + late_ns))
        return [crop_and_resize(image, self.geometry) for image in decoded if image is not None]

    def _curve(self, stamp_ns: Int64Array, value: FloatArray) -> Curve:
        dwell_start_ns = self.record.dwell_start_ns
        start_ns = self.recording.start_ns if dwell_start_ns is None else dwell_start_ns
        zero_ns = start_ns - self._force_late_ns
        return Curve(time_s=_seconds(stamp_ns - zero_ns), value=value)


class RunReading:
    """The attempts of a run that count: of each trial the latest passed, or else the latest."""

    def __init__(self, store: RunStore, geometry: ImageGeometry) -> None:
        self.store = store
        self.geometry = geometry  # how frames become scored images; the sensor's file knows it
        # What the protocol wrote, by trial; None for one that has not ended.
        self.records = {index: store.counting(index) for index in store.trial_indices()}
        self._attempts: dict[int, AttemptReading] = {}

    def of(self, trials: Collection[int]) -> Self:
        """Return some of its trials; what was read of them is shared."""
        part = copy(self)
        part.records = {index: self.records[index] for index in self.records if index in trials}
        return part

    def attempt(self, trial: int) -> AttemptReading | None:
        """Return what is read of a trial; None where no recording of it can be opened."""
        record = self.records[trial]
        return None if record is None else readable(lambda: self.read(record))

    def read(self, record: TrialRecord) -> AttemptReading:
        """Return what is read of an attempt, its recording opened once."""
        if record.index not in self._attempts:
            self._attempts[record.index] = AttemptReading(self.store, record, self.geometry)
        return self._attempts[record.index]


def readable(read: Callable[[], T]) -> T | None:
    """Return what is read; None where it is damaged, which the check of the run names."""
    try:
        return read()
    except RecordError as error:
        logger.info("%s", error)
        return None


def decode_frame(frame: ImageFrame) -> ImageArray | None:
    """Decode a JPEG frame to RGB, shape [height, width, 3]; None when it is no whole image."""
    image = decode_rgb(frame.jpeg)
    if image is None:
        logger.warning("frame %d (%d bytes) is no image; left out", frame.counter, len(frame.jpeg))
    return image


def crop_and_resize(image: ImageArray, geometry: ImageGeometry) -> ImageArray:
    """Cut the borders off and average down to the scored size.

    Raises:
        RecordError: The crop leaves fewer pixels than the scored image has.
    """
    height, width = image.shape[:2]
    top = math.floor(height * geometry.crop_fraction)
    left = math.floor(width * geometry.crop_fraction)
    cropped = image[top : height - top, left : width - left]
    if cropped.shape[0] < geometry.height_px or cropped.shape[1] < geometry.width_px:
        raise RecordError(
            f"a {width}x{height} px frame is smaller after the crop than the scored"
            f" {geometry.width_px}x{geometry.height_px} px",
            remedy="choose a larger camera mode, or a smaller image in the sensor's file",
        )
    size = (geometry.width_px, geometry.height_px)
    resized = cv2.resize(np.ascontiguousarray(cropped), size, interpolation=cv2.INTER_AREA)
    return np.asarray(resized, dtype=np.uint8)


def median_image(images: Sequence[ImageArray]) -> ImageArray:
    """Return the pixelwise median of at least one image, rounded to 8 bits."""
    return np.asarray(np.rint(np.median(np.stack(images), axis=0)), dtype=np.uint8)


def summarize_stream(
    name: str,
    stamp_ns: Int64Array,
    counter: Int64Array | None = None,
    nominal_rate_hz: float | None = None,
) -> StreamSummary | None:
    """Reduce a stream's arrivals to rate, losses and percentiles; None of fewer than two."""
    if len(stamp_ns) < 2:
        return None
    intervals_s = _seconds(np.diff(stamp_ns))
    median, late = np.percentile(intervals_s, [50, 99]) * 1e3
    return StreamSummary(
        name=name,
        nominal_rate_hz=nominal_rate_hz,
        rate_hz=float(len(intervals_s) / intervals_s.sum()),
        sample_count=len(stamp_ns),
        lost_count=None if counter is None else int(counter[-1] - counter[0] + 1 - len(counter)),
        interval_median_ms=float(median),
        interval_p99_ms=float(late),
        interval_max_ms=float(intervals_s.max() * 1e3),
    )


def _seconds(duration_ns: Int64Array) -> FloatArray:
    return np.asarray(duration_ns * 1e-9, dtype=np.float64)
