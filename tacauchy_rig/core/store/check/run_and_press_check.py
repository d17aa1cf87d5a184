"""All checks of a run: what its report, its replay, ``recover`` and ``resume`` ask first.

Journal, description and replays are held against themselves, their hashes and each other; what was
measured of a press is computed again from the raw samples of its recording.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.config.load import hash_of_values
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.force_sensor_gain import ARM_WINDOW_S, ARM_ZERO_S
from tacauchy_rig.core.run import FZ, Criterion, JournalEvent, Tare, TrialRecord
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.atomic_write import bytes_sha256
from tacauchy_rig.core.store.check.attempt_files_check import (
    RECOVER,
    TRIAL,
    Attempt,
    consistency,
    hash_mismatch,
    judge_events,
    judge_files,
    judge_streams,
    short_hash,
    within,
)
from tacauchy_rig.core.store.journal import Journal, JournalLine, StoreEvent
from tacauchy_rig.core.store.json_codec import to_json
from tacauchy_rig.core.store.recording.mcap_reader import ArmArrays, ForceArrays, Recording
from tacauchy_rig.core.store.run_files import is_inside
from tacauchy_rig.core.store.run_store import RunStore

Z = 2  # of a position
_MM = 1e3  # in a metre; depths are read in millimetres

STANDARD_ERRORS = 3.0
"""Of a mean: 99.7 % of the means of half of its samples lie within."""

ROUNDING_N = 1e-9
"""Samples and means are doubles on both sides: 1e4 samples of 1e3 N sum to 1e4 * 1e3 * 1e-16 N."""

TURN_DEPTH_M = 3e-6
"""The protocol averages the depth of its turns, the check that of all states of the arm: at the
0.3 mm/s of a press a turn of 10 ms lies 3 um from its neighbour."""

CONTACT_DEPTH_M = 5e-5
"""From the turn that found contact to the line that says so the arm runs on, at a fifth of the
search's speed, for a few turns and until it has come to rest."""

REMEDY = f"recording.mcap and result.json tell of different presses. {RECOVER}"


def judge_press(attempt: Attempt, recording: Recording, record: TrialRecord) -> Iterator[Criterion]:
    """Yield tare, mean force, sign, drift, depth and the arm's force, against what was said.

    Both sides average the same raw samples between the same stamps, unfiltered, so on a whole
    recording they agree to rounding. One that lost up to half of them in a crash still has their
    mean to its standard error.
    """
    force, tare, after = recording.force, record.tare_before, record.tare_after
    if tare is None:
        return
    yield _tare(attempt, "recorded_tare", tare, force)
    if record.force_measured_n is not None:
        yield from _force(attempt, record, record.force_measured_n, tare, force)
    if after is not None:
        yield _tare(attempt, "recorded_tare_after", after, force)
    if record.force_drift_n is not None and after is not None:
        sign = attempt.store.config.force_sensor.compression_sign
        drift_n = sign * (after.mean[FZ] - tare.mean[FZ])
        yield _same("recorded_drift", drift_n, record.force_drift_n, ROUNDING_N, "N")
    if record.depth_measured_m is not None and record.contact_z_m is not None:
        yield _depth(recording.arm, record, record.contact_z_m, record.depth_measured_m)
    if record.arm_force_n is not None and attempt.is_whole:
        yield from _arm_force(attempt, recording.arm, record, record.arm_force_n)


def _force(
    attempt: Attempt, record: TrialRecord, measured_n: float, tare: Tare, force: ForceArrays
) -> Iterator[Criterion]:
    sign = attempt.store.config.force_sensor.compression_sign
    pressed_n = force.between(record.dwell_start_ns, record.dwell_end_ns)
    unloaded_n = force.between(tare.start_ns, tare.end_ns)
    rise_n = float(_mean_force(pressed_n)[FZ]) - float(_mean_force(unloaded_n)[FZ])
    # Of what is left of the samples.
    error_n = math.hypot(
        _standard_error(record.force_deviation_n or 0.0, len(pressed_n)),
        _standard_error(tare.deviation[FZ], tare.sample_count),
    )
    limit_n = ROUNDING_N + STANDARD_ERRORS * (0.0 if attempt.is_whole else error_n)
    yield _same("recorded_force", sign * rise_n, measured_n, limit_n, "N")
    yield Criterion(
        name="recorded_sign",
        measured=rise_n,
        passed=math.copysign(1.0, measured_n) * sign * rise_n > limit_n,
        limit=f"raw Fz moves to {'plus' if sign * measured_n > 0.0 else 'minus'} where result.json"
        f" says {measured_n:.6g} N with compression_sign {sign:+d}",
        unit="N",
        remedy=REMEDY,
    )
    if record.force_deviation_n is not None and attempt.is_whole:
        found_n = float(pressed_n[:, FZ].std(ddof=1)) if len(pressed_n) > 1 else math.nan
        yield _same("recorded_deviation", found_n, record.force_deviation_n, ROUNDING_N, "N")


def _tare(attempt: Attempt, name: str, tare: Tare, force: ForceArrays) -> Criterion:
    """Judge the axis that is furthest off for its noise; one that nobody measured is not."""
    found_n = _mean_force(force.between(tare.start_ns, tare.end_ns))
    errors = [_standard_error(d, tare.sample_count) for d in tare.deviation[:3]]
    limits_n = [ROUNDING_N + STANDARD_ERRORS * (0.0 if attempt.is_whole else e) for e in errors]
    off = [
        -1.0 if math.isnan(again) and math.isnan(stated) else abs(again - stated) / limit_n
        for again, stated, limit_n in zip(found_n, tare.mean, limits_n, strict=False)
    ]
    worst = max(range(3), key=lambda axis: math.inf if math.isnan(off[axis]) else off[axis])
    axis = f", raw F{'xyz'[worst]}"
    return _same(name, float(found_n[worst]), tare.mean[worst], limits_n[worst], "N", what=axis)


def _depth(arm: ArmArrays, record: TrialRecord, contact_z_m: float, depth_m: float) -> Criterion:
    """Judge the mean depth in the dwell; the height of contact has to be where the arm was."""
    z_m = np.empty(0)
    if dwell := record.windows.get("dwell"):
        z_m = arm.pose[within(arm.stamp_ns, *dwell), Z]
    found_m = contact_z_m - float(z_m.mean()) if len(z_m) else math.nan
    limit_m = TURN_DEPTH_M + (STANDARD_ERRORS * float(np.std(z_m)) if len(z_m) else 0.0)
    return _same("recorded_depth", found_m * _MM, depth_m * _MM, limit_m * _MM, "mm")


def _arm_force(
    attempt: Attempt, arm: ArmArrays, record: TrialRecord, stated_n: float
) -> Iterator[Criterion]:
    """Judge the force that the arm felt in the dwell, less what it felt before the search.

    The protocol averages at its turns, the check at every state: on a busy computer the means of
    dwell and zero are both of other windows, by what such means scatter.
    """
    begun, dwell = _entered(attempt, "search"), record.windows.get("dwell")
    if begun is None or dwell is None:
        return
    stamp_ns, felt_n = _arm_means(arm)
    dwell_n = felt_n[within(stamp_ns, *dwell)]
    # The arm stands still for its zero, in earlier runs for 0.3 s.
    first_ns, last_ns = (begun.stamp_ns + round(s * 1e9) for s in (ARM_WINDOW_S, ARM_ZERO_S))
    zero_n = felt_n[within(stamp_ns, first_ns, last_ns)]
    found_n, limit_n = math.nan, ROUNDING_N
    if len(dwell_n) and len(zero_n):
        # As the session had it: a resumed one may count the other way.
        sign = begun.detail.get("force_sign", attempt.store.config.robot.force_sign)
        found_n = sign * float(dwell_n.mean() - zero_n.mean())
        limit_n += STANDARD_ERRORS * math.sqrt(2.0) * float(dwell_n.std())
    yield _same("recorded_arm_force", found_n, stated_n, limit_n, "N")


def _arm_means(arm: ArmArrays) -> tuple[Int64Array, FloatArray]:
    """Return stamps of the arm's estimates and the mean [N] of each window that ends there."""
    has_estimate = np.isfinite(arm.tcp_force[:, FZ])
    stamp_ns = arm.stamp_ns[has_estimate]
    total_n = np.concatenate([[0.0], np.cumsum(arm.tcp_force[has_estimate, FZ])])
    ends = np.arange(1, len(total_n))
    starts = np.searchsorted(stamp_ns, stamp_ns - round(ARM_WINDOW_S * 1e9))
    return stamp_ns, (total_n[ends] - total_n[starts]) / (ends - starts)


def judge_contact(
    attempt: Attempt, recording: Recording, record: TrialRecord
) -> Iterator[Criterion]:
    """Yield whether the arm was at the height of contact when that was found."""
    found = _entered(attempt, "press")
    if record.contact_z_m is None or found is None:
        return
    arm = recording.arm
    before = np.flatnonzero(arm.stamp_ns <= found.stamp_ns)
    height_m = float(arm.pose[before[-1], Z]) if len(before) else math.nan
    stated_m = found.detail.get("contact_z_m", record.contact_z_m)
    limit_m = ROUNDING_N if stated_m != record.contact_z_m else CONTACT_DEPTH_M
    stated = record.contact_z_m * _MM
    yield _same("recorded_contact", height_m * _MM, stated, limit_m * _MM, "mm")


def _entered(attempt: Attempt, phase: str) -> JournalEvent | None:
    """Return the journal's last word of a phase of the attempt; None where it has none."""
    phases = [e for e in attempt.events if e.name == "phase" and e.detail.get("phase") == phase]
    return phases[-1] if phases else None


def _mean_force(wrenches: FloatArray) -> FloatArray:
    """Return mean raw Fx, Fy, Fz [N]; NaN where there is no sample."""
    return np.asarray(wrenches[:, :3].mean(axis=0)) if len(wrenches) else np.full(3, math.nan)


def _standard_error(deviation: float, sample_count: int) -> float:
    return deviation / math.sqrt(max(sample_count, 1))


def _same(
    name: str, found: float, stated: float, limit: float, unit: str, *, what: str = ""
) -> Criterion:
    return Criterion(
        name=name,
        measured=found,
        passed=abs(found - stated) <= limit,
        limit=f"within {limit:.2g} {unit} of {stated:.6g} {unit}, as result.json says{what}",
        unit=unit,
        remedy=REMEDY,
    )


_JOURNAL_REMEDY = (
    "journal.jsonl was edited or damaged after it was written: nothing puts that right. "
    "Restore it from a copy, or record a new run"
)
_DESCRIPTION_REMEDY = (
    "what the run is was edited after it was recorded: restore run.json and rig.toml from a copy, "
    "or record a new run"
)


def judge_run(
    store: RunStore, journal: Journal, attempts: Sequence[Attempt]
) -> Iterator[Criterion]:
    """Yield what holds of the run as a whole: description, journal, folders and replays."""
    yield consistency(
        "run_description",
        "run.json and the files beside it are unchanged since the run was recorded",
        _changed_description(store, journal),
        remedy=_DESCRIPTION_REMEDY,
    )
    yield from _judge_journal(journal, was_begun=bool(attempts))
    yield consistency(
        "journal_attempts",
        "every attempt that journal.jsonl tells of has its folder, and the other way round",
        _unmatched_attempts(journal, attempts),
    )
    logged = {str(event.detail.get("name")) for event in journal.store_events(StoreEvent.REPLAYED)}
    names = logged | {path.name for path in store.paths.replays.glob("*") if path.is_dir()}
    if names:
        yield consistency(
            "replay_files",
            "simulated forces and images are those that were made from these recordings",
            [line for name in sorted(names) for line in _changed_replay(store, name, journal)],
            remedy="`tacauchy-rig replay RUN` makes forces and images again from what was recorded",
        )


def _unmatched_attempts(journal: Journal, attempts: Sequence[Attempt]) -> Iterator[str]:
    names = ("attempt-start", StoreEvent.SEALED)
    logged = {(e.trial, e.attempt) for e in journal.events if e.name in names}
    for trial, attempt in sorted(logged - {(each.trial, each.attempt) for each in attempts}):
        yield f"attempt {attempt} at trial {trial} is in journal.jsonl and has no folder"
    for each in attempts:
        has_result = each.record is not None or each.unreadable
        if has_result and (each.trial, each.attempt) not in logged:
            yield f"{each.name} is unknown to journal.jsonl"


def _judge_journal(journal: Journal, *, was_begun: bool) -> Iterator[Criterion]:
    """Yield what holds of a journal whatever else is in the run, which may have attempts."""
    gone = ["journal.jsonl is missing"] if was_begun and not journal.exists else []
    yield consistency(
        "journal_chain",
        "each line of journal.jsonl has its number and the hash of the line before it",
        [*gone, *_broken_links(journal.lines), *_doubles(journal.lines)],
        remedy=_JOURNAL_REMEDY,
    )
    ending = "its last session has no run-end: the program was cut off, or lines were taken off"
    yield consistency(
        "journal_end",
        "journal.jsonl tells how every session ended",
        [ending] if journal.is_open else [],
        remedy="if the program was cut off, `tacauchy-rig recover RUN` notes that in the journal",
    )


def _broken_links(lines: Sequence[JournalLine]) -> Iterator[str]:
    before = ""
    for place, line in enumerate(lines, start=1):
        where = f"journal.jsonl line {place}"
        if line.event is None:  # half a line: the next whole one holds the hash of the last half
            following = lines[place] if place < len(lines) else line
            if following.event and following.previous != bytes_sha256(line.raw):
                yield f"{where} is no event, and the next line tells of another one"
        elif line.number != place:
            yield f"{where} ({line.event.name}) is numbered {line.number!r}"
        elif line.previous != before:
            yield (
                f"{where} ({line.event.name}) follows a line with the hash "
                f"{short_hash(line.previous)}, the line before it has {short_hash(before)}"
            )
        before = bytes_sha256(line.raw)


def _doubles(lines: Sequence[JournalLine]) -> Iterator[str]:
    seen: dict[str, int] = {}
    for place, line in enumerate(lines, start=1):
        if line.event is None:
            continue
        first = seen.setdefault(json.dumps(to_json(line.event), sort_keys=True), place)
        if first != place:
            yield f"journal.jsonl line {place} ({line.event.name}) is line {first} again"


def _changed_description(store: RunStore, journal: Journal) -> Iterator[str]:
    described, stated = store.description, store.config_hash
    recorded = described.get("config")
    found = hash_of_values(recorded)
    if found != stated:
        hashes = short_hash(found), short_hash(stated)
        yield "run.json: config has the hash {}, config_hash says {}".format(*hashes)
    for field, kept, read in _differing(recorded, store.config.model_dump(mode="json")):
        yield f"run.json: config.{field} is {kept!r}, as written it reads {read!r}"
    answered = described["devices"].items()
    pretending = [name for name, device in answered if device.get("simulated")]
    if pretending and not store.simulated:
        yield f"run.json: simulated is false, but so is no {', '.join(pretending)}"
    for file in (store.truth, store.force_check, store.expected, store.optics):
        if damage := file.damage():
            yield damage
    try:
        _ = store.imported_trials
    except RecordError as error:
        yield error.message
    yield from _hashes(store, journal)


def _hashes(store: RunStore, journal: Journal) -> Iterator[str]:
    written = store.description.get("rig_toml_sha256")
    yield from hash_mismatch(store.paths.root, store.paths.rig_toml.name, written)
    sealed = journal.store_events(StoreEvent.WRITTEN)
    for name in dict.fromkeys(str(event.detail.get("file")) for event in sealed):
        logged = [event for event in sealed if event.detail.get("file") == name]
        known = [event.detail.get("sha256") for event in logged]
        # The line goes out before the file: where it is the journal's last, a crash may have left
        # the file that the line before tells of, or none.
        if known[-1] is None:
            if not journal.was_cut:
                yield f"{name} could not be read and was set aside"
            continue
        may_be_older = journal.events[-1] is logged[-1]
        if not may_be_older or len(logged) > 1:
            yield from hash_mismatch(store.paths.root, name, *known[-2 if may_be_older else -1 :])


def _differing(kept: Any, read: Any, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield fields of a recorded configuration that read otherwise now."""
    if isinstance(kept, dict) and isinstance(read, dict):
        for name in kept.keys() & read.keys():
            where = f"{prefix}.{name}" if prefix else name
            yield from _differing(kept[name], read[name], where)
    elif kept != read:
        yield prefix, kept, read


def _changed_replay(store: RunStore, name: str, journal: Journal) -> Iterator[str]:
    if not is_inside(name):
        yield f"journal.jsonl tells of a replay {name!r}, which is no name of a folder"
        return
    path = store.paths.replay_json(name)
    logged = [e for e in journal.store_events(StoreEvent.REPLAYED) if e.detail.get("name") == name]
    if not path.exists():
        if logged:
            yield f"replay/{name}/replay.json is missing; journal.jsonl says that it was made"
        return
    try:
        replay = store.load_replay(name)
    except RecordError as error:
        yield error.message
        return
    if logged:
        known = logged[-1].detail.get("replay_sha256")
        yield from hash_mismatch(path.parent, path.name, known, name=f"replay/{name}/replay.json")
    else:
        yield f"replay/{name} is unknown to journal.jsonl"
    yield from _source_mismatches(store, name, replay)
    folder = store.paths.replays / name
    for file, known in replay.files.items():
        yield from hash_mismatch(folder, file, known, name=f"replay/{name}/{file}")
    for trial in replay.trials:
        for made in sorted(store.paths.replay_trial(name, trial.index).glob("*")):
            if str(made.relative_to(folder)) not in replay.files:
                yield f"replay/{name}: {made.relative_to(folder)} was not made by this replay"
    yield from _force_mismatches(store, name, replay)


def _source_mismatches(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    sensor = Path(store.config.sensor.name)
    for file, known in replay.made_from.items():
        if file == "sensor":
            yield from hash_mismatch(sensor.parent, sensor.name, known, name=f"sensor {sensor}")
        elif file != "config":
            yield from hash_mismatch(store.paths.root, file, known, name=file)
        elif known != store.config_hash:
            yield (
                f"replay/{name} was made with the configuration {short_hash(known)}, the run's is "
                f"{short_hash(store.config_hash)}"
            )


def _force_mismatches(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    """Yield trials that were replayed to another force than was measured."""
    for trial in replay.trials:
        record = store.counting(trial.index)
        measured_n = None if record is None else record.force_measured_n
        pressed_n = None if math.isnan(trial.force_measured_n) else trial.force_measured_n
        if pressed_n != measured_n:
            to, says = ("none" if n is None else f"{n!r} N" for n in (pressed_n, measured_n))
            yield f"replay/{name} pressed trial {trial.index} to {to}, result.json says {says}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunCheck:
    """What was checked, met or not."""

    run: tuple[Criterion, ...]  # of the run as a whole
    attempts: dict[tuple[int, int], tuple[Criterion, ...]]  # by trial and attempt
    # What is no contradiction and should be known: sessions and attempts that were cut off,
    # settings that were changed for a session, and recordings that were repaired
    notes: tuple[str, ...]
    # SHA-256 of the journal's last line. It stands for all that is sealed: written down elsewhere,
    # it shows any later change.
    journal_head: str

    @property
    def passed(self) -> bool:
        """True where nothing contradicts anything."""
        return not any(self._missed())

    def missed(self) -> Iterator[str]:
        """Yield a line for each criterion that is not met: where, which, what, and what to do."""
        return (f"{where}{_line(criterion)}" for where, criterion in self._missed())

    def _missed(self) -> Iterator[tuple[str, Criterion]]:
        places = [("", self.run)]
        places += [(f"trial {t}, attempt {a}: ", each) for (t, a), each in self.attempts.items()]
        return ((where, c) for where, each in places for c in each if not c.passed)


def check_run(store: RunStore) -> RunCheck:
    """Hold all that a run says of itself against its recordings, its journal and its hashes.

    Raises:
        RecordError: The journal is no longer readable; the message names the line.
    """
    journal = Journal.read(store.paths.journal)
    attempts = [Attempt(store, journal, *key) for key in store.paths.attempts()]
    return RunCheck(
        run=tuple(judge_run(store, journal, attempts)),
        attempts={
            (each.trial, each.attempt): tuple(
                replace(criterion, remedy=criterion.remedy.replace(TRIAL, str(each.trial)))
                for criterion in (*judge_files(each), *_judge_content(each))
            )
            for each in attempts
        },
        notes=tuple(_notes(journal, attempts)),
        journal_head=journal.head,
    )


def _judge_content(attempt: Attempt) -> Iterator[Criterion]:
    record, recording = attempt.record, attempt.recording
    if recording is None:
        return
    try:
        yield judge_events(attempt, recording)
        if record is not None:
            yield from judge_streams(attempt, recording, record)
            yield from judge_press(attempt, recording, record)
            yield from judge_contact(attempt, recording, record)
    # A message that no longer decodes, or a number that nothing can be compared with.
    except (RecordError, ValueError, TypeError, OverflowError) as error:
        yield consistency(
            "recording_decodes",
            "every message of the recording decodes",
            [f"{attempt.name}/recording.mcap: {error}"],
        )


def _notes(journal: Journal, attempts: Sequence[Attempt]) -> Iterator[str]:
    if journal.was_cut:
        yield "A session of this run was cut off; what was on the disk then was kept."
    yield from _changed_settings(journal)
    for each in attempts:
        for event in each.cut_off:
            yield (
                f"Attempt {each.attempt} at trial {each.trial} is unfinished: "
                f"{event.detail.get('why')}."
            )
        for event in each.repacked:
            yield (
                f"The recording of trial {each.trial}, attempt {each.attempt} was repacked by "
                f"recover: it was {event.detail.get('before')}."
            )


def _changed_settings(journal: Journal) -> Iterator[str]:
    """Yield a sentence for each field that a session went on with changed."""
    since = "before the first attempt"
    for event in journal.events:
        if event.name == "attempt-start":
            since = f"after trial {event.trial}, attempt {event.attempt}"
        elif event.name == "resume-set":
            changes = event.detail.get("changes")
            tables = changes if isinstance(changes, list) else []
            for change in (each for each in tables if isinstance(each, dict)):
                old = change.get("old") or "nothing"
                yield (
                    f"`resume --set` changed {change.get('field')} from {old} to "
                    f"{change.get('new')} for one session, {since}."
                )


def _line(criterion: Criterion) -> str:
    value = criterion.measured
    measured = "not measured" if math.isnan(value) else f"{value:.6g} {criterion.unit}".rstrip()
    return f"{criterion.name}: {measured}, required: {criterion.limit} -> {criterion.remedy}"
