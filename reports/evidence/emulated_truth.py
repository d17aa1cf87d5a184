"""Truth of a dry run's emulated gel: true force and depth, from the emulator's trace."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from reports.evidence.evidence_types import EmulatedWorld
from reports.evidence.frames_and_curves import readable
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.store.run_files import open_file
from tacauchy_rig.core.store.run_store import RunStore

FORCE_TRACE = "force_trace.jsonl"
Z = 2
MIN_TRACE_SAMPLES = 10


def emulated_world(
    store: RunStore, records: Mapping[int, TrialRecord | None]
) -> EmulatedWorld | None:
    """Return what is known of the world of a dry run; None of any other run."""
    values = readable(store.truth.load)
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
