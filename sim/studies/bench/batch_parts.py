"""What the launches of a batch's tick take, each alone, and taking the stress off afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from sim.batch.batch import Batch
from sim.batch.phases import ADVANCE_SEARCH, EVALUATE, SEARCH, START

_REPEATS = 50
# Any but zero, which would be no work on the CPU.
_SOURCE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchPartsRow:
    """Times of a tick's launches, all environments doing the same.

    Attributes:
        doing: Evaluating forces, or searching by conjugate gradients.
        parts_s: Of each launch [s].
    """

    environments: int
    doing: str
    parts_s: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class StressTimes:
    """What the stress on the surface of all environments takes (paper, Algorithm 1).

    Attributes:
        face_count: Faces of an environment.
        device_s: From displacements to stresses, both on the device [s].
        host_s: The same with its launch from the host and the copy to the host's memory [s].
    """

    face_count: int
    device_s: float
    host_s: float


def stress_times(batch: Batch, *, repeats: int = _REPEATS) -> StressTimes:
    """Time taking the stress off the last press; the shortest of the ways to the host."""
    extraction = batch.tick.stress
    device_s = _time_of(extraction.launch, device=batch.device, repeats=repeats)
    fetched = []
    for _ in range(repeats):
        started = time.perf_counter()
        batch.surface_stresses()
        fetched.append(time.perf_counter() - started)
    return StressTimes(face_count=extraction.face_count, device_s=device_s, host_s=min(fetched))


def batch_parts(batch: Batch, *, repeats: int = _REPEATS) -> list[BatchPartsRow]:
    """Time the launches of a tick on the untouched gel; the batch is reset."""
    rows = []
    for doing, phase, act in (("forces", EVALUATE, START), ("search", SEARCH, ADVANCE_SEARCH)):
        parts = {}
        for name, launch in batch.tick.launches.items():
            batch.tick.reset()
            progress = batch.tick.progress
            progress.phase.fill_(phase)
            progress.act.fill_(act)
            batch.tick.sources.fill_(_SOURCE)
            parts[name] = _time_of(launch, device=batch.device, repeats=repeats)
        rows.append(BatchPartsRow(environments=len(batch.environments), doing=doing, parts_s=parts))
    batch.tick.reset()
    return rows


def _time_of(launch: Callable[[], None], *, device: str, repeats: int) -> float:
    """Return the mean time of a launch [s]; on a GPU from one graph of them all."""
    launch()
    if device == "cpu":
        started = time.perf_counter()
        for _ in range(repeats):
            launch()
        return (time.perf_counter() - started) / repeats
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(repeats):
            launch()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    started = time.perf_counter()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    return (time.perf_counter() - started) / repeats
