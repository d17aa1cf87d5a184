"""From a run folder, its replay and an emulator's trace to the evidence of a report."""

import json
import math
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from reports.evidence import evidence_types
from reports.evidence.frames_and_curves import RunReading, readable
from reports.evidence.intermediate_states import intermediate_states
from tacauchy_rig.core.config.settings import REFINE_RATIO, RigConfig, Stated, stated_uncertainty
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.known_weight import ForceCheck
from tacauchy_rig.core.run import Criterion, JournalEvent, TrialRecord
from tacauchy_rig.core.simulated import ForceDepthCurve, Replay, model_of
from tacauchy_rig.core.store.check.attempt_files_check import RESULT_HASH, RESULT_WHOLE, consistency
from tacauchy_rig.core.store.check.run_and_press_check import RunCheck, check_run
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.run_files import open_file, read_bytes
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series

FORCE_TRACE = "force_trace.jsonl"
Z = 2
MIN_TRACE_SAMPLES = 10


def emulated_world(
    store: RunStore, records: Mapping[int, TrialRecord | None]
) -> evidence_types.EmulatedWorld | None:
    """Return what is known of the world of a dry run; None of any other run."""
    values = readable(store.truth.load)
    if values is None:
        return None
    windows = {
        index: record.windows["dwell"]
        for index, record in records.items()
        if record is not None and "dwell" in record.windows
    }
    return evidence_types.EmulatedWorld(
        values=values,
        surface_expected_m=store.config.sensor.surface[Z],
        dwells=read_true_dwells(store.paths.emulation / FORCE_TRACE, windows),
    )


def read_true_dwells(
    trace: Path, windows: Mapping[int, tuple[int, int]]
) -> dict[int, tuple[float, float]]:
    """Return the mean true force [N] and depth [m] over each trial's dwell.

    Args:
        trace: ``force_trace.jsonl`` of the emulated force sensor, one frame a line. A trace that
            is missing or was started anew after an interruption gives fewer trials.
        windows: Per trial, first and last stamp of the dwell [ns].
    """
    if not trace.is_file():
        return {}
    largest = 1 << 30
    samples: dict[int, list[tuple[float, float]]] = {index: [] for index in windows}
    with (
        open_file(trace, what="what the emulators noted", max_bytes=largest) as descriptor,
        open(descriptor, encoding="utf-8", errors="replace", closefd=False) as lines,
    ):
        for stamp, force, depth in _trace_rows(lines):
            for index, (start, end) in windows.items():
                if start <= stamp <= end:
                    samples[index].append((force, depth))
    means = {i: np.mean(v, axis=0) for i, v in samples.items() if len(v) >= MIN_TRACE_SAMPLES}
    return {i: (float(m[0]), float(m[1])) for i, m in means.items()}


def _trace_rows(lines: Iterator[str]) -> Iterator[tuple[int, float, float]]:
    for line in lines:
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            continue  # the emulator was killed while it wrote its last line
        found = row if isinstance(row, dict) else {}
        stamp, force, depth = (found.get(f) for f in ("stamp_ns", "force_true_n", "depth_true_m"))
        if isinstance(stamp, int) and all(isinstance(v, int | float) for v in (force, depth)):
            yield stamp, force or 0.0, depth or 0.0


CLOCK_SINCE_NS, CLOCK_UNTIL_NS = 946_684_800 * 10**9, 4_102_444_800 * 10**9
"""The years 2000 and 2100: stamps outside are not counted from 1970."""


def load_evidence(run: RunReading, replay: Replay | None) -> evidence_types.RunEvidence:
    """Read all that a report needs.

    Args:
        run: The attempts that count; what was read of them before is not read again.
        replay: Its replay; None where it was not replayed, which every trial then misses.

    What is damaged is a criterion that is missed, and otherwise as if it were not there.

    Raises:
        RecordError: No result of the run can be read, though it has some; or its journal cannot.
    """
    store, config = run.store, run.store.config
    replayed = {} if replay is None else {trial.index: trial for trial in replay.trials}
    seen = {
        index: _read_trial(run, index, replay if index in replayed else None)
        for index in run.records
    }
    check = check_run(store)
    _require_a_result(check, run)
    force_check, series = readable(store.force_check.load), force_series(store)
    trials = tuple(
        evidence_types.TrialEvidence(
            index=index,
            force_target_n=_target_n(store, index, record),
            force_tolerance_n=config.report.max_force_mismatch if config.is_imported else 0.0,
            record=record,
            replay=replayed.get(index),
            force_depth_simulated=stated_curve(replay, index)
            if replay is not None and index in replayed
            else None,
            kind=0 if replay is None else replay.models.index(model_of(replay.models, index)),
            checks=(
                *_checks(check, index, record),
                *seen[index][1],
                *filter(None, [series.criterion(index, 0 if record is None else record.attempt)]),
            ),
            place_known=index not in store.imported_trials
            or store.imported_trials[index].place_m is not None,
            **seen[index][0],
        )
        for index, record in run.records.items()
    )
    picture = store.paths.calibration_picture
    return evidence_types.RunEvidence(
        trials=trials,
        simulated=store.simulated,
        thresholds=config.report,
        geometry=run.geometry,
        provenance={
            **_provenance(store, replay),
            "recorded": _recorded_at(store, run.records),
            "journal_head": check.journal_head,
        },
        # A journal that is gone is a criterion missed, not the end of a report.
        journal=summarize_journal(Journal.read(store.paths.journal).events),
        contact_force_n=config.protocol.contact_force,
        stated=stated_of_run(config, force_check),
        model=None if replay is None else replay.model,
        others=() if replay is None else replay.others,
        sync_mode=config.run.sync_mode.value,
        force_check=force_check,
        force_history=series.history,
        weighed_after=series.weighed is not None,
        unchecked_allowed=config.limits.allow_unchecked_force,
        world=emulated_world(store, run.records),
        checks=check.run,
        imported=store.imported.load(),
        optics=readable(store.optics.load),
        optics_picture=read_bytes(picture, what="the picture of the optics")
        if picture.is_file()
        else b"",
        notes=(*check.notes, *_of_other_attempts(check, run)),
    )


def stated_of_run(config: RigConfig, check: ForceCheck | None) -> dict[str, Stated]:
    """Return what a run states of cell, heights and delays; a hung weight tells of the cell.

    The defaults are of devices as ours: of an imported run only counts what its source states.
    """
    names: tuple[str, ...] = ("depth", "delay", "force_scale")
    if config.is_imported:
        names = tuple(name for name in names if getattr(config.uncertainty, name) is not None)
    stated = {name: stated_uncertainty(config, name) for name in names}
    if check is not None and check.passed and config.uncertainty.force_scale is None:
        weight = check.weight
        off = math.hypot(check.ratio - 1.0, weight.uncertainty_kg / weight.mass_kg)
        stated["force_scale"] = Stated(value=off, source=f"what the cell made of {weight}")
    plain = {"contact_force": config.protocol.contact_force}
    if not config.is_imported:
        plain["search_speed"] = config.robot.search_speed / REFINE_RATIO
    return stated | {name: Stated(value=v, source="rig.toml") for name, v in plain.items()}


def _target_n(store: RunStore, index: int, record: TrialRecord | None) -> float:
    """Return what was asked of a press [N]; of an imported one what was measured, or NaN."""
    if not store.config.is_imported:
        return store.config.protocol.force_targets[index - 1]
    measured = None if record is None else record.force_measured_n
    return math.nan if measured is None else measured


def _require_a_result(check: RunCheck, run: RunReading) -> None:
    """Refuse a report that would have nothing to report but damage."""
    damaged = [
        c
        for each in check.attempts.values()
        for c in each
        if c.name == RESULT_WHOLE and not c.passed
    ]
    if damaged and not any(run.records.values()):
        raise RecordError(
            f"{run.store.paths.root}: nothing is left to report: no result of it can be read "
            f"({damaged[0].limit})",
            remedy=damaged[0].remedy,
        )


def _checks(check: RunCheck, trial: int, record: TrialRecord | None) -> tuple[Criterion, ...]:
    """Return what is said of the attempt that counts.

    The result of a later attempt might have counted, so what is wrong with it counts too.
    """
    counting = 0 if record is None else record.attempt
    later = [
        criterion
        for (index, attempt), criteria in check.attempts.items()
        for criterion in criteria
        if index == trial and attempt > counting
        if criterion.name in (RESULT_WHOLE, RESULT_HASH) and not criterion.passed
    ]
    return (*check.attempts.get((trial, counting), ()), *later)


def _of_other_attempts(check: RunCheck, run: RunReading) -> Iterator[str]:
    """Yield what contradicts what in attempts that do not count, in a sentence each."""
    counting = {(r.index, r.attempt) for r in run.records.values() if r is not None}
    for (trial, attempt), criteria in check.attempts.items():
        missed = [c for c in criteria if not c.passed and (trial, attempt) not in counting]
        for criterion in missed:
            name = criterion.name.replace("_", " ")
            yield (
                f"Attempt {attempt} at trial {trial}, which does not count, misses {name}; "
                f"required: {criterion.limit}."
            )


_RECORDED = ("images", "streams", "dwell_s", "force_curve", "depth_curve")


def _read_trial(
    run: RunReading, index: int, replay: Replay | None
) -> tuple[dict[str, Any], tuple[Criterion, ...]]:
    """Return what was recorded and simulated, by the fields of a trial's evidence, and damage."""
    attempt = run.attempt(index)
    recorded = {} if attempt is None else {name: getattr(attempt, name) for name in _RECORDED}
    if replay is None:
        return recorded, ()
    try:
        kept = run.store.load_replay_fields(replay.name, index)
    except RecordError as error:
        promise = f"what was simulated of trial {index} is readable"
        lost = consistency("replay_whole", promise, [error.message], remedy=error.remedy)
        return recorded, (lost,)
    passed = intermediate_states(kept.passed, attempt)
    return {**recorded, "simulated_image": kept.image, "intermediate": passed}, ()


def stated_curve(replay: Replay, trial: int) -> ForceDepthCurve | None:
    """Return what a trial's model gives with the modulus that is stated."""
    model = model_of(replay.models, trial)
    stiffer = model.modulus_factor or 1.0
    alike = [t for t in replay.trials if model_of(replay.models, t.index) is model]
    fitted = [[(d, f / stiffer) for d, f in each.force_history] for each in alike]
    return ForceDepthCurve.merged([model.stated_force_history or (), *fitted])


def summarize_journal(events: list[JournalEvent]) -> evidence_types.JournalSummary:
    """Count attempts, faults, aborts and resumptions, and keep what was said of each fault."""
    names = [event.name for event in events]
    return evidence_types.JournalSummary(
        attempt_count=names.count("attempt-start"),
        fault_count=names.count("fault") + names.count("process-died"),
        abort_count=names.count("abort"),
        resume_count=names.count("resume"),
        faults=tuple(
            _describe(event) for event in events if event.name in ("fault", "abort", "process-died")
        ),
    )


def _describe(event: JournalEvent) -> str:
    where = f"trial {event.trial}, attempt {event.attempt}: " if event.trial else ""
    detail: Mapping[str, Any] = event.detail
    reason = detail.get("reason") or f"{detail.get('process', '')} {detail.get('how', '')}".strip()
    return f"{where}{event.name}: {reason or 'no reason given'}"


def _provenance(store: RunStore, replay: Replay | None) -> dict[str, Any]:
    described, imported = store.description, store.imported.load()
    return {
        "name": described.get("name", store.paths.root.name),
        "created": described.get("created"),
        "run_folder": store.paths.root.name,
        "config_hash": store.config_hash,
        "seed": described.get("seed") if store.simulated else None,
        "operator": store.config.run.operator,
        "versions": described.get("versions", {}),
        "replay": None if replay is None else replay.name,
        "replay_versions": {} if replay is None else replay.versions,
        "devices": described.get("devices", {}),
        "imported": {}
        if imported is None
        else {
            **{name: getattr(imported, name) for name in ("kind", "source", "has_clock")},
            "file_count": len(imported.files),
        },
    }


def _recorded_at(store: RunStore, records: Mapping[int, TrialRecord | None]) -> str | None:
    """Return when the first press was recorded, in ISO 8601; None where that is not known.

    Only stamps of an import that count from 1970 tell it: what others' clocks count from is
    theirs.
    """
    if not store.config.is_imported:
        return str(store.description.get("created") or "") or None
    starts = [r.dwell_start_ns for r in records.values() if r and r.dwell_start_ns is not None]
    if not starts or not CLOCK_SINCE_NS < min(starts) < CLOCK_UNTIL_NS:
        return None
    return datetime.fromtimestamp(min(starts) // 10**9, UTC).isoformat()
