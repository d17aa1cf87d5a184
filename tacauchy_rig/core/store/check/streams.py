"""The streams of a recording: there, in order, each sample once, as many as were counted."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.run import Criterion, TrialRecord
from tacauchy_rig.core.store.check.attempt import Attempt
from tacauchy_rig.core.store.check.contradiction import agreement
from tacauchy_rig.core.store.recording.reading import Recording


def judge_streams(
    attempt: Attempt, recording: Recording, record: TrialRecord
) -> Iterator[Criterion]:
    """Yield whether force, arm and images are there as they were counted."""
    looks = {
        "force": lambda: _force(attempt, record),
        "arm": lambda: _arm(attempt),
        "image": lambda: _frames(attempt, recording, record),
    }
    imported = attempt.store.imported_trials.get(attempt.trial)
    there = list(looks) if imported is None else imported.streams
    yield agreement(
        "recorded_streams",
        f"{', '.join(there)}: each is there, in order, each sample once",
        [line for name in there for line in looks[name]()],
    )
    if _says_new(record):
        yield _images(recording, record)


def _images(recording: Recording, record: TrialRecord) -> Criterion:
    return agreement(
        "recorded_images",
        "no two images of dwell and no-contact window are the same to the byte",
        _repeated(recording, record),
        remedy="the camera or its driver sent old images: see `tacauchy-rig doctor`, then press "
        "the trial again: `tacauchy-rig resume RUN --again TRIAL`",
    )


def _force(attempt: Attempt, record: TrialRecord) -> Iterator[str]:
    force = attempt.force
    yield from _disorder("force", force.stamp_ns, force.counter)
    counted = record.rates.get("force_count")
    if attempt.is_whole and counted is not None and len(force.counter) != counted:
        yield f"force has {len(force.counter)} samples, result.json counted {counted:g}"
    for name, tare in (("before", record.tare_before), ("after", record.tare_after)):
        if tare is None:
            continue
        found = int(np.count_nonzero(within(force.stamp_ns, tare.start_ns, tare.end_ns)))
        if attempt.is_whole and found != tare.sample_count:
            yield f"force has {found} samples in the tare {name}, result.json {tare.sample_count}"


def _arm(attempt: Attempt) -> Iterator[str]:
    arm = attempt.arm
    states: FloatArray = np.column_stack([arm.controller_time_s, arm.pose, arm.velocity])
    yield from _disorder("arm", arm.stamp_ns, None)
    if len(states) < 2:
        return
    same = (np.diff(arm.stamp_ns) == 0) & (np.diff(states, axis=0) == 0.0).all(axis=1)
    if same.any():
        first_ns = arm.stamp_ns[:-1][same][0]
        yield f"arm has {int(same.sum())} states twice, the first at {first_ns} ns"


def _frames(attempt: Attempt, recording: Recording, record: TrialRecord) -> Iterator[str]:
    stamps, counters = recording.frame_stamps()
    yield from _disorder("image", stamps, counters)
    said = {criterion.name: criterion.measured for criterion in record.criteria}
    for name, start_ns, end_ns in (
        ("dwell_frames", record.dwell_start_ns, record.dwell_end_ns),
        ("reference_frames", record.reference_start_ns, record.reference_end_ns),
    ):
        counted = said.get(name)
        if counted is None or start_ns is None or end_ns is None or not attempt.is_whole:
            continue
        found = int(np.count_nonzero(within(stamps, start_ns, end_ns)))
        if found < counted:  # one that reached control late was not counted in its time
            yield f"{name}: {found} images, result.json counted {counted:g}"


def _disorder(name: str, stamps: Int64Array, counters: Int64Array | None) -> Iterator[str]:
    if not len(stamps):
        yield f"{name} has no sample"
        return
    if counters is None:
        return
    steps = np.diff(counters)
    wrong = np.flatnonzero(steps <= 0)
    if len(wrong):
        where = int(wrong[0]) + 1
        yield (
            f"{name} counts {counters[where - 1]}, then {counters[where]}, at {stamps[where]} ns "
            f"({len(wrong)} such places)"
        )


def _says_new(record: TrialRecord) -> bool:
    """Return whether the result says that no image is an old one.

    One that passed says so. One that failed by old images, or that they stopped before it was
    judged, says the same as its recording.
    """
    judged = {criterion.name: criterion.passed for criterion in record.criteria}
    return record.passed or judged.get("repeated_frames", False)


def _repeated(recording: Recording, record: TrialRecord) -> Iterator[str]:
    seen: dict[bytes, int] = {}
    repeated: list[tuple[int, int]] = []
    for start_ns, end_ns in (
        (record.reference_start_ns, record.reference_end_ns),
        (record.dwell_start_ns, record.dwell_end_ns),
    ):
        if start_ns is None or end_ns is None:
            continue
        for frame in recording.frames(start_ns, end_ns):
            first = seen.setdefault(hashlib.sha256(frame.jpeg).digest(), frame.counter)
            if first != frame.counter:
                repeated.append((frame.counter, first))
    if repeated:
        counter, first = repeated[0]
        yield f"image {counter} is image {first} again ({len(repeated)} such images)"


def within(stamps: Int64Array, start_ns: int, end_ns: int) -> np.ndarray:
    """Return which stamps lie in a window, both ends included."""
    return (stamps >= start_ns) & (stamps <= end_ns)
