"""From a run folder and its replay to the evidence of a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from reports.arrays import ColorImage, FloatArray
from reports.evidence.evidence import (
    Curve,
    EmulatedWorld,
    ImageGeometry,
    JournalSummary,
    RunEvidence,
    StreamTiming,
    Thresholds,
    TrialEvidence,
    TrialImages,
)
from reports.evidence.extraction import depth_curve, force_curve, stream_timing, trial_images
from reports.scores.force_agreement import merge_histories
from reports.truth import read_true_dwells
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.run import JournalEvent, Replay, TrialRecord
from tacauchy_rig.store.journal import read_journal
from tacauchy_rig.store.recording.reading import Recording
from tacauchy_rig.store.run_store import RunStore

FORCE_TRACE = "force_trace.jsonl"
Z, FZ = 2, 2


def load_evidence(
    store: RunStore, replay: Replay | None, *, geometry: ImageGeometry | None = None
) -> RunEvidence:
    """Read all that a report needs.

    Of each trial the latest passed attempt counts, or else the latest that ended.

    Args:
        store: The run.
        replay: Its replay; None where it was not replayed, which every trial then misses.
        geometry: How frames become scored images; the sensor's file knows it.

    Raises:
        RecordError: A recording or a replayed image is missing or damaged.
    """
    geometry = geometry or ImageGeometry()
    config = store.config
    records = {
        index: store.accepted(index) or store.latest(index)
        for index in range(1, len(config.protocol.force_targets) + 1)
    }
    replayed = {} if replay is None else {trial.index: trial for trial in replay.trials}
    curve = _stated_curve(replay)
    trials = []
    for index, target in enumerate(config.protocol.force_targets, start=1):
        recorded = _read_attempt(store, records[index], geometry)
        trials.append(
            TrialEvidence(
                index=index,
                force_target_n=target,
                record=records[index],
                replay=replayed.get(index),
                simulated_image=_simulated_image(store, replay, index),
                force_depth_simulated=curve,
                **recorded,
            )
        )
    return RunEvidence(
        trials=tuple(trials),
        simulated=store.simulated,
        thresholds=Thresholds(
            max_force_mismatch_n=config.report.max_force_mismatch,
            ssim=config.report.ssim,
            require_discrimination=config.report.require_discrimination,
        ),
        geometry=geometry,
        provenance=_provenance(store, replay),
        journal=summarize_journal(read_journal(store.paths.journal)),
        contact_force_n=config.protocol.contact_force,
        model={} if replay is None else replay.model,
        sync_mode=config.run.sync_mode.value,
        world=_world(store, records),
    )


def _stated_curve(replay: Replay | None) -> FloatArray | None:
    """Return what the replay's model gives with the modulus that is stated: (depth, force)."""
    if replay is None:
        return None
    stiffer = replay.model.get("modulus_factor", 1.0)
    fitted = [[(d, f / stiffer) for d, f in trial.force_history] for trial in replay.trials]
    stated = [(d, f) for d, f in replay.model.get("stated_force_history", ())]
    return merge_histories([stated, *fitted])


def _read_attempt(
    store: RunStore, record: TrialRecord | None, geometry: ImageGeometry
) -> dict[str, Any]:
    if record is None:
        return {}
    path = store.paths.recording(record.index, record.attempt)
    if not record.passed and not path.exists():
        return {}
    recording = Recording.open(path)
    return {
        "images": _images(recording, record, geometry),
        "streams": _streams(recording, store.config),
        "dwell_s": _dwell(record),
        **_curves(recording, record, store.config),
    }


def _images(
    recording: Recording, record: TrialRecord, geometry: ImageGeometry
) -> TrialImages | None:
    if record.dwell_start_ns is None or record.reference_start_ns is None:
        return None
    return trial_images(
        recording.frames(record.dwell_start_ns, record.dwell_end_ns),
        recording.frames(record.reference_start_ns, record.reference_end_ns),
        geometry,
    )


def _dwell(record: TrialRecord) -> tuple[float, float] | None:
    if record.dwell_start_ns is None or record.dwell_end_ns is None:
        return None
    return 0.0, (record.dwell_end_ns - record.dwell_start_ns) * 1e-9


def _curves(
    recording: Recording, record: TrialRecord, config: RigConfig
) -> dict[str, Curve | None]:
    zero = recording.start_ns if record.dwell_start_ns is None else record.dwell_start_ns
    force, depth = None, None
    if record.tare_before is not None:
        raw = recording.force()
        force = force_curve(
            raw.stamp_ns,
            raw.wrench,
            tare_fz_n=record.tare_before.mean[FZ],
            sign=config.force_sensor.compression_sign,
            zero_ns=zero,
        )
    if record.contact_z_m is not None:
        arm = recording.arm()
        depth = depth_curve(arm.stamp_ns, arm.pose, contact_z_m=record.contact_z_m, zero_ns=zero)
    return {"force_curve": force, "depth_curve": depth}


def _streams(recording: Recording, config: RigConfig) -> tuple[StreamTiming, ...]:
    force = recording.force()
    frame_stamps, frame_counters = recording.frame_stamps()
    return (
        stream_timing(
            "force",
            force.stamp_ns,
            counter=force.counter,
            nominal_rate_hz=config.force_sensor.rate,
        ),
        stream_timing(
            "image", frame_stamps, counter=frame_counters, nominal_rate_hz=config.camera.rate
        ),
        stream_timing("arm", recording.arm().stamp_ns),
    )


def _simulated_image(store: RunStore, replay: Replay | None, index: int) -> ColorImage | None:
    if replay is None or all(trial.index != index for trial in replay.trials):
        return None
    return store.load_replay_fields(replay.name, index).image


def summarize_journal(events: list[JournalEvent]) -> JournalSummary:
    """Count attempts, faults, aborts and resumptions, and keep what was said of each fault."""
    names = [event.name for event in events]
    return JournalSummary(
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
    described = store.description
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
    }


def _world(store: RunStore, records: Mapping[int, TrialRecord | None]) -> EmulatedWorld | None:
    values = store.load_truth()
    if values is None:
        return None
    windows = {
        index: (record.dwell_start_ns, record.dwell_end_ns)
        for index, record in records.items()
        if record is not None
        and record.dwell_start_ns is not None
        and record.dwell_end_ns is not None
    }
    return EmulatedWorld(
        values=values,
        surface_expected_m=store.config.sensor.surface[Z],
        dwells=read_true_dwells(store.paths.emulation / FORCE_TRACE, windows),
    )
