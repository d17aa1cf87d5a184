"""What is at hand to check an attempt, and what holds of its files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.check.files import (
    SET_ASIDE,
    JournalReading,
    consistency,
    hash_mismatch,
    short_hash,
)
from tacauchy_rig.core.store.codec import dumps, to_json
from tacauchy_rig.core.store.journal import StoreEvent
from tacauchy_rig.core.store.recording.reading import ArmArrays, ForceArrays, Recording
from tacauchy_rig.core.store.run_store import RunStore

RESULT_WHOLE, RESULT_HASH = "result_whole", "result_hash"
RECOVER = "`tacauchy-rig recover RUN` repairs what can be repaired of it; " + SET_ASIDE


@dataclass(frozen=True)
class Attempt:
    """An attempt at a trial: its files, and what the journal says of it."""

    store: RunStore
    journal: JournalReading
    trial: int
    attempt: int

    @property
    def key(self) -> tuple[int, int]:
        """Trial and attempt."""
        return self.trial, self.attempt

    @property
    def name(self) -> str:
        """The attempt's folder within the run."""
        return str(self.path.parent.relative_to(self.store.paths.root))

    @property
    def path(self) -> Path:
        """Its recording."""
        return self.store.paths.recording(*self.key)

    @cached_property
    def result(self) -> TrialRecord | RecordError | None:
        """The result, or why it cannot be read; None where it was cut off before it had one."""
        try:
            return self.store.load_result(*self.key)
        except RecordError as error:
            return error

    @property
    def record(self) -> TrialRecord | None:
        """The result; None where there is none, or none that can be read."""
        return None if isinstance(self.result, RecordError) else self.result

    @cached_property
    def recording(self) -> Recording | RecordError:
        """The recording, or why it cannot be opened."""
        try:
            return self.store.recording(*self.key)
        except RecordError as error:
            return error

    @property
    def force(self) -> ForceArrays:
        """The force stream; only where the recording opens."""
        return self._opened().force()

    @property
    def arm(self) -> ArmArrays:
        """The arm's states; only where the recording opens."""
        return self._opened().arm()

    def _opened(self) -> Recording:
        if isinstance(self.recording, RecordError):
            raise self.recording
        return self.recording

    @cached_property
    def sealed_event(self) -> JournalEvent | None:
        """What the journal says that its files were; None where a power cut took what it says."""
        was_cut = self.store_events(StoreEvent.CUT_OFF)
        return None if was_cut else next(iter(self.store_events(StoreEvent.SEALED)), None)

    @property
    def is_whole(self) -> bool:
        """True where the recording was closed in its time and never repacked since."""
        closed = self.record is not None and self.record.recording_sha256 is not None
        return closed and not self.store_events(StoreEvent.RECOVERED)

    def store_events(self, name: StoreEvent) -> list[JournalEvent]:
        """Return what the store wrote into the journal about this attempt."""
        return self.journal.store_events(name, trial=self.trial, attempt=self.attempt)


def judge_files(attempt: Attempt) -> Iterator[Criterion]:
    """Yield whether the files are readable, in their place, and those that were sealed."""
    yield consistency(
        "recording_whole",
        f"every message of {attempt.name}/recording.mcap is readable",
        _damage(attempt),
        remedy=RECOVER,
    )
    if isinstance(attempt.recording, Recording):
        yield consistency(
            "recording_place",
            f"{attempt.name}/recording.mcap is of this run, trial and attempt",
            _misplaced(attempt, attempt.recording),
        )
        yield consistency(
            "recording_hash",
            f"{attempt.name}/recording.mcap is the file that was closed",
            _recording_mismatch(attempt),
        )
    yield consistency(
        RESULT_WHOLE,
        f"{attempt.name}/result.json is readable",
        [attempt.result.message] if isinstance(attempt.result, RecordError) else [],
    )
    yield consistency(
        RESULT_HASH,
        f"{attempt.name}/result.json is the file that was written",
        _result_mismatch(attempt),
    )
    if attempt.record is not None:
        yield consistency(
            "recorded_result",
            f"{attempt.name}/result.json says what journal.jsonl and run.json say",
            _result_contradictions(attempt, attempt.record),
        )


def _damage(attempt: Attempt) -> Iterator[str]:
    recording, record = attempt.recording, attempt.record
    if isinstance(recording, RecordError):
        if attempt.path.exists() or (record is not None and record.outcome is not Outcome.FAULT):
            yield recording.message
    elif recording.damage:
        yield f"{attempt.name}/recording.mcap: {recording.damage}; {recording.readable()}"
    elif not recording.finished and attempt.is_whole:
        yield f"{attempt.name}/recording.mcap is {recording.describe()}, and it was closed once"


def _misplaced(attempt: Attempt, recording: Recording) -> Iterator[str]:
    store = attempt.store
    wanted = {
        "run": store.description.get("run"),
        "trial": str(attempt.trial),
        "attempt": str(attempt.attempt),
        "config_hash": store.config_hash,
    }
    for key, value in wanted.items():
        found = recording.metadata.get(key)
        unknown = value is None or (found is None and not attempt.is_whole)
        if not unknown and found != value:
            yield f"its {key} is {found!r}, the folder's is {value!r}"


def _recording_mismatch(attempt: Attempt) -> Iterator[str]:
    record, sealed_event, repacked = (
        attempt.record,
        attempt.sealed_event,
        attempt.store_events(StoreEvent.RECOVERED),
    )
    in_result = None if record is None else record.recording_sha256
    in_journal = None if sealed_event is None else sealed_event.detail.get("recording_sha256")
    if sealed_event is not None and record is not None and in_result != in_journal:
        yield (
            f"result.json says that its sha256 was {short_hash(in_result)}, journal.jsonl "
            f"{short_hash(in_journal)}"
        )
    known = repacked[-1].detail.get("recording_sha256") if repacked else in_result or in_journal
    if known is not None:
        yield from hash_mismatch(attempt.path.parent, attempt.path.name, known)
    originals = [event.detail.get("original_sha256") for event in repacked]
    if in_result is not None and repacked and in_result not in originals:
        yield (
            f"it was closed with the sha256 {short_hash(in_result)}, then damaged, and what was "
            f"readable of {short_hash(originals[0])} was repacked"
        )


def _result_mismatch(attempt: Attempt) -> Iterator[str]:
    sealed_event, journal = attempt.sealed_event, attempt.journal
    if sealed_event is not None:
        path = attempt.store.paths.result(*attempt.key)
        yield from hash_mismatch(path.parent, path.name, sealed_event.detail.get("result_sha256"))
    elif attempt.record is not None and journal.has_hashes and not journal.may_lack_hashes:
        yield "journal.jsonl does not know of it"


def _result_contradictions(attempt: Attempt, record: TrialRecord) -> Iterator[str]:
    """Yield what the result says otherwise than journal and configuration do."""
    if (record.index, record.attempt) != attempt.key:
        yield f"it tells of attempt {record.attempt} at trial {record.index}"
    targets = attempt.store.config.protocol.force_targets
    target = targets[attempt.trial - 1] if attempt.trial <= len(targets) else None
    if record.force_target_n != target and not attempt.store.config.is_imported:
        yield f"its force_target_n is {record.force_target_n!r}, run.json says {target!r}"
    missed = [c.name for c in record.criteria if not c.passed]
    if record.passed and (missed or not record.criteria):
        yield f"its outcome is passed, with criteria missed: {', '.join(missed) or 'all'}"
    for event in attempt.journal.of_attempt(*attempt.key):
        if event.name != "attempt-end":
            continue
        for field, logged in event.detail.items():
            stated = to_json(getattr(record, field, logged))
            if stated != logged and not (field == "reason" and record.outcome is Outcome.FAULT):
                yield f"its {field} is {stated!r}, journal.jsonl says {logged!r}"


def judge_events(attempt: Attempt, recording: Recording) -> Criterion:
    """Say whether journal and recording hold the same events of the attempt."""
    return consistency(
        "recorded_events",
        f"journal.jsonl and {attempt.name}/recording.mcap hold the same events",
        _event_contradictions(attempt, recording),
    )


def _event_contradictions(attempt: Attempt, recording: Recording) -> Iterator[str]:
    in_recording = {dumps(event, indent=None): event for event in recording.events()}
    logged = _until_its_end(attempt.journal.of_attempt(*attempt.key))
    in_journal = {dumps(event, indent=None): event for event in logged}
    if attempt.journal.exists:
        for key, event in in_recording.items():
            if key not in in_journal:
                yield f"journal.jsonl lacks {_named(event)}"
    shared = [key for key in in_journal if key in in_recording]
    for key, wanted in zip(shared, [k for k in in_recording if k in in_journal], strict=True):
        if key != wanted:
            yield f"journal.jsonl has {_named(in_journal[key])} in another order"
    if attempt.is_whole:
        for key, event in in_journal.items():
            if key not in in_recording:
                yield f"the recording lacks {_named(event)}"


def _until_its_end(events: Sequence[JournalEvent]) -> Sequence[JournalEvent]:
    """Leave out events logged after the recording of the attempt was closed."""
    ends = [place for place, event in enumerate(events) if event.name == "attempt-end"]
    return events[: ends[-1] + 1] if ends else events


def _named(event: JournalEvent) -> str:
    return f"{event.name} {event.detail.get('phase', '')}".strip() + f" at {event.stamp_ns} ns"


def judge_streams(
    attempt: Attempt, recording: Recording, record: TrialRecord
) -> Iterator[Criterion]:
    """Yield whether force, arm and images are there as they were counted."""
    checks = {
        "force": lambda: _force(attempt, record),
        "arm": lambda: _arm(attempt),
        "image": lambda: _frames(attempt, recording, record),
    }
    imported = attempt.store.imported_trials.get(attempt.trial)
    there = list(checks) if imported is None else imported.streams
    yield consistency(
        "recorded_streams",
        f"{', '.join(there)}: each is there, in order, each sample once",
        [line for name in there for line in checks[name]()],
    )
    if _claims_new_images(record):
        yield _images(recording, record)


def _images(recording: Recording, record: TrialRecord) -> Criterion:
    return consistency(
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
    stated = {criterion.name: criterion.measured for criterion in record.criteria}
    for name, start_ns, end_ns in (
        ("dwell_frames", record.dwell_start_ns, record.dwell_end_ns),
        ("reference_frames", record.reference_start_ns, record.reference_end_ns),
    ):
        counted = stated.get(name)
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


def _claims_new_images(record: TrialRecord) -> bool:
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
