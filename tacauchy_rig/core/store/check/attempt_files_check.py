"""An attempt's files against their hashes, and its result against journal and recording."""

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from tacauchy_rig.core.arrays import Int64Array
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import Journal, StoreEvent
from tacauchy_rig.core.store.json_codec import dumps, to_json
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_files import file_sha256, is_inside
from tacauchy_rig.core.store.run_store import RunStore

TRIAL = "TRIAL"
"""In a remedy, where the trial's number goes."""
SET_ASIDE = (
    "the file was edited, exchanged or damaged after it was written. "
    f"`tacauchy-rig resume RUN --again {TRIAL}` presses the trial once more"
)
RECOVER = "`tacauchy-rig recover RUN` repairs what can be repaired of it; " + SET_ASIDE
_WRITTEN_OUT = 3
"""Contradictions that are written out; one edit often breaks many lines."""
_SHOWN_HASH = 12
"""Digits of a hash that are written out: 48 bits, and the file has the rest."""


def consistency(
    name: str, condition: str, contradictions: Iterable[str], *, remedy: str = SET_ASIDE
) -> Criterion:
    """Return a criterion that is met where nothing contradicts a condition.

    Args:
        name: Of the criterion, such as ``recording_hash``.
        condition: What has to hold, in words.
        contradictions: Each names the file and both values.
        remedy: What to do where it does not hold.
    """
    found = list(contradictions)
    logged = "; ".join(found[:_WRITTEN_OUT])
    more = f"; and {len(found) - _WRITTEN_OUT} more" if len(found) > _WRITTEN_OUT else ""
    return Criterion(
        name=name,
        passed=not found,
        measured=float(len(found)),
        limit=f"{condition}; but {logged}{more}" if found else condition,
        unit="wrong",
        remedy=remedy,
    )


def hash_mismatch(folder: Path, file: str, *known: object, name: str = "") -> Iterator[str]:
    """Yield that a file is missing, or is none of those that are known.

    Args:
        folder: Where it lies; what leads out of it is not read.
        file: The file within it.
        known: SHA-256 that it may have, the newest last.
        name: What it is called; left out, its own name.
    """
    path = folder / file
    if not is_inside(file):
        yield f"{file!r} is no name of a file of the run"
        return
    if not path.is_file():
        yield f"{name or path.name} is missing"
        return
    found = file_sha256(path, what="a file of the run")
    if found not in known:
        now, before = short_hash(found), short_hash(known[-1])
        yield f"{name or path.name} has the sha256 {now}, and had {before}"


def short_hash(sha256: object) -> str:
    """Return a hash as it is written out."""
    return str(sha256 or "none")[:_SHOWN_HASH]


RESULT_WHOLE, RESULT_HASH = "result_whole", "result_hash"


class Attempt:
    """An attempt at a trial: its files, and what the journal says of it.

    Attributes:
        record: Its result; None where there is none, or none that can be read.
        unreadable: Why its result cannot be read; empty where it can, or there is none.
        recording: None where it cannot be opened, for the reason ``unopened``.
        events: What the protocol wrote of it into the journal.
        sealed: What the journal says that its files were; None where a power cut took what it says.
        repacked: Journal events of its recording's recovery.
        cut_off: Journal events of a result of it that no longer counts.
    """

    def __init__(self, store: RunStore, journal: Journal, trial: int, attempt: int) -> None:
        self.store, self.journal, self.trial, self.attempt = store, journal, trial, attempt
        self.path = store.paths.recording(trial, attempt)
        self.record: TrialRecord | None = None
        self.recording: Recording | None = None
        self.unreadable = self.unopened = ""
        try:
            self.record = store.load_result(trial, attempt)
        except RecordError as error:
            self.unreadable = error.message
        try:
            self.recording = store.recording(trial, attempt)
        except RecordError as error:
            self.unopened = error.message
        self.events = journal.of_attempt(trial, attempt)
        sealed, self.repacked, self.cut_off = (
            journal.store_events(name, trial=trial, attempt=attempt)
            for name in (StoreEvent.SEALED, StoreEvent.RECOVERED, StoreEvent.CUT_OFF)
        )
        self.sealed = sealed[0] if sealed and not self.cut_off else None

    @property
    def name(self) -> str:
        """The attempt's folder within the run."""
        return str(self.path.parent.relative_to(self.store.paths.root))

    @property
    def is_whole(self) -> bool:
        """True where the recording was closed in its time and never repacked since."""
        closed = self.record is not None and self.record.recording_sha256 is not None
        return closed and not self.repacked


def judge_files(attempt: Attempt) -> Iterator[Criterion]:
    """Yield whether the files are readable, in their place, and those that were sealed."""
    recording, result = f"{attempt.name}/recording.mcap", f"{attempt.name}/result.json"
    yield consistency(
        "recording_whole",
        f"every message of {recording} is readable",
        _damage(attempt),
        remedy=RECOVER,
    )
    if attempt.recording is not None:
        yield consistency(
            "recording_place",
            f"{recording} is of this run, trial and attempt",
            _misplaced(attempt, attempt.recording),
        )
        yield consistency(
            "recording_hash",
            f"{recording} is the file that was closed",
            _recording_mismatch(attempt),
        )
    unreadable = [attempt.unreadable] if attempt.unreadable else []
    yield consistency(RESULT_WHOLE, f"{result} is readable", unreadable)
    yield consistency(
        RESULT_HASH, f"{result} is the file that was written", _result_mismatch(attempt)
    )
    if attempt.record is not None:
        yield consistency(
            "recorded_result",
            f"{result} says what journal.jsonl and run.json say",
            _result_contradictions(attempt, attempt.record),
        )


def _damage(attempt: Attempt) -> Iterator[str]:
    recording, record = attempt.recording, attempt.record
    if recording is None:
        if attempt.path.exists() or (record is not None and record.outcome is not Outcome.FAULT):
            yield attempt.unopened
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
    record, sealed, repacked = attempt.record, attempt.sealed, attempt.repacked
    in_result = None if record is None else record.recording_sha256
    in_journal = None if sealed is None else sealed.detail.get("recording_sha256")
    if sealed is not None and record is not None and in_result != in_journal:
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
    if attempt.sealed is not None:
        sha256 = attempt.sealed.detail.get("result_sha256")
        yield from hash_mismatch(attempt.path.parent, "result.json", sha256)
    elif attempt.record is not None and not attempt.journal.may_lack_lines:
        yield "journal.jsonl does not know of it"


def _result_contradictions(attempt: Attempt, record: TrialRecord) -> Iterator[str]:
    """Yield what the result says otherwise than journal and configuration do."""
    targets = attempt.store.config.protocol.force_targets
    target = targets[attempt.trial - 1] if attempt.trial <= len(targets) else None
    if record.force_target_n != target and not attempt.store.config.is_imported:
        yield f"its force_target_n is {record.force_target_n!r}, run.json says {target!r}"
    missed = [c.name for c in record.criteria if not c.passed]
    if record.passed and (missed or not record.criteria):
        yield f"its outcome is passed, with criteria missed: {', '.join(missed) or 'all'}"
    for event in attempt.events:
        if event.name != "attempt-end":
            continue
        for name, logged in event.detail.items():
            stated = to_json(getattr(record, name, logged))
            if stated != logged and not (name == "reason" and record.outcome is Outcome.FAULT):
                yield f"its {name} is {stated!r}, journal.jsonl says {logged!r}"


def judge_events(attempt: Attempt, recording: Recording) -> Criterion:
    """Say whether journal and recording hold the same events of the attempt."""
    return consistency(
        "recorded_events",
        f"journal.jsonl and {attempt.name}/recording.mcap hold the same events",
        _event_contradictions(attempt, recording),
    )


def _event_contradictions(attempt: Attempt, recording: Recording) -> Iterator[str]:
    in_recording = {dumps(event, indent=None): event for event in recording.events()}
    # Not those that were logged after the recording of the attempt was closed.
    ends = [place for place, event in enumerate(attempt.events) if event.name == "attempt-end"]
    logged = attempt.events[: ends[-1] + 1] if ends else attempt.events
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


def _named(event: JournalEvent) -> str:
    return f"{event.name} {event.detail.get('phase', '')}".strip() + f" at {event.stamp_ns} ns"


def judge_streams(
    attempt: Attempt, recording: Recording, record: TrialRecord
) -> Iterator[Criterion]:
    """Yield whether force, arm and images are there as they were counted."""
    checks = {"force": _force, "arm": _arm, "image": _frames}
    imported = attempt.store.imported_trials.get(attempt.trial)
    there = list(checks) if imported is None else imported.streams
    yield consistency(
        "recorded_streams",
        f"{', '.join(there)}: each is there, in order, each sample once",
        [line for name in there for line in checks[name](attempt, recording, record)],
    )
    # A result that passed says that no image is an old one. One that failed by old images, or that
    # they stopped before it was judged, says the same as its recording.
    judged = {criterion.name: criterion.passed for criterion in record.criteria}
    if record.passed or judged.get("repeated_frames", False):
        yield consistency(
            "recorded_images",
            "no two images of dwell and no-contact window are the same to the byte",
            _repeated(recording, record),
            remedy="the camera or its driver sent old images: see `tacauchy-rig doctor`, then "
            "press the trial again: `tacauchy-rig resume RUN --again TRIAL`",
        )


def _force(attempt: Attempt, recording: Recording, record: TrialRecord) -> Iterator[str]:
    force = recording.force
    yield from _disorder("force", force.stamp_ns, force.counter, record)
    if not attempt.is_whole:
        return
    counted = record.rates.get("force_count")
    if counted is not None and len(force.counter) != counted:
        yield f"force has {len(force.counter)} samples, result.json counted {counted:g}"
    for name, tare in (("before", record.tare_before), ("after", record.tare_after)):
        found = 0 if tare is None else len(force.between(tare.start_ns, tare.end_ns))
        if tare is not None and found != tare.sample_count:
            yield f"force has {found} samples in the tare {name}, result.json {tare.sample_count}"


def _arm(_attempt: Attempt, recording: Recording, record: TrialRecord) -> Iterator[str]:
    arm = recording.arm
    if record.passed and not len(arm.stamp_ns):
        yield "arm has no sample"
    states = np.column_stack([arm.controller_time_s, arm.pose, arm.velocity])
    same = (np.diff(arm.stamp_ns) == 0) & (np.diff(states, axis=0) == 0.0).all(axis=1)
    if same.any():
        first_ns = arm.stamp_ns[:-1][same][0]
        yield f"arm has {int(same.sum())} states twice, the first at {first_ns} ns"


def _frames(attempt: Attempt, recording: Recording, record: TrialRecord) -> Iterator[str]:
    stamps, counters = recording.frame_stamps()
    yield from _disorder("image", stamps, counters, record)
    stated = {criterion.name: criterion.measured for criterion in record.criteria}
    for name, window in record.windows.items():
        counted = stated.get(f"{name}_frames")
        if counted is None or not attempt.is_whole:
            continue
        found = int(np.count_nonzero(within(stamps, *window)))
        if found < counted:  # one that reached control late was not counted in its time
            yield f"{name}_frames: {found} images, result.json counted {counted:g}"


def _disorder(
    name: str, stamps: Int64Array, counters: Int64Array, record: TrialRecord
) -> Iterator[str]:
    # An attempt may fail before a device has sent anything.
    if record.passed and not len(stamps):
        yield f"{name} has no sample"
    wrong = np.flatnonzero(np.diff(counters) <= 0)
    if len(wrong):
        where = int(wrong[0]) + 1
        yield (
            f"{name} counts {counters[where - 1]}, then {counters[where]}, at {stamps[where]} ns "
            f"({len(wrong)} such places)"
        )


def _repeated(recording: Recording, record: TrialRecord) -> Iterator[str]:
    seen: dict[bytes, int] = {}
    repeated: list[tuple[int, int]] = []
    for name, window in record.windows.items():
        for frame in recording.frames(*window) if name != "tare" else ():
            first = seen.setdefault(hashlib.sha256(frame.jpeg).digest(), frame.counter)
            if first != frame.counter:
                repeated.append((frame.counter, first))
    if repeated:
        counter, first = repeated[0]
        yield f"image {counter} is image {first} again ({len(repeated)} such images)"


def within(stamps: Int64Array, start_ns: int, end_ns: int) -> np.ndarray:
    """Return which stamps lie in a window, both ends included."""
    return (stamps >= start_ns) & (stamps <= end_ns)
