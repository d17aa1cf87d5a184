"""A recorded run and its twin side by side, on one page with a time slider."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from reports.evidence.attempt import AttemptReading, RunReading, median_image
from sim.twin.follower import NO_FORCE_N, Goal
from tacauchy_rig.app.replay.optics import OpticalCalibration, Say, say_nothing
from tacauchy_rig.app.twin.twin import Twin, contact_residual, jpeg_of, maps_of, twin_of
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RecordError

FRAMES_PER_S = 5.0
_MARGIN_NS = 400_000_000
_TEMPLATE, _DATA = "watch.html", "{{ data }}"


def watch_run(
    run: RunReading, *, optics: OpticalCalibration | None = None, on_progress: Say = say_nothing
) -> Path:
    """Have a twin follow what was recorded, at its own pace, and write the page of it.

    Args:
        run: The run; the page is written into its folder.
        optics: How images are made; None takes the configured calibration, or the nominal lamps.

    Returns:
        The page: one file that needs no other.

    Raises:
        RecordError: No trial has a recorded contact.
        ConfigError: There is nothing to simulate or render with.
    """
    config = run.store.config
    twin = twin_of(config, optics=optics)
    trials: list[tuple[int, list[dict[str, Any]]]] = []
    for trial in run.records:
        attempt = run.attempt(trial)
        frames = [] if attempt is None else list(_frames(attempt, twin))
        if frames:
            on_progress(f"trial {trial}: {len(frames)} frames")
            trials.append((trial, frames))
    if not trials:
        raise RecordError(
            f"{run.store.paths.root}: no trial has images of a contact",
            remedy="press, or look at the run with `tacauchy-rig recover`",
        )
    facts = {
        "run": run.store.paths.root.name,
        "simulated": run.store.simulated,
        "basis": twin.follower.stated_error.basis,
        "trials": [{"trial": trial, "frames": frames} for trial, frames in trials],
    }
    page = _template().replace(_DATA, json.dumps(facts).replace("</", "<\\/"))
    run.store.paths.watch.write_text(page, "utf-8")
    return run.store.paths.watch


def _template() -> str:
    return resources.files(__package__).joinpath(_TEMPLATE).read_text("utf-8")


def watch_script() -> str:
    """Return the one script of the page."""
    return _template().partition("<script>")[2].partition("</script>")[0]


def _frames(attempt: AttemptReading, twin: Twin) -> Iterator[dict[str, Any]]:
    """Yield a trial's frames from before the contact until after it."""
    record, force, images = attempt.record, attempt.force, twin.images
    curve = attempt.force_curve
    if curve is None or record.reference_start_ns is None:
        return
    touched = force.stamp_ns[_lasting(curve.value > NO_FORCE_N)]
    if not len(touched):
        return
    before = attempt.recording.frames(record.reference_start_ns, record.reference_end_ns)
    unloaded = [image for image in (images.of(each.jpeg) for each in before) if image is not None]
    if not unloaded:
        return
    background = median_image(unloaded)
    twin.follower.unloaded(background)
    start_ns, end_ns = int(touched[0]) - _MARGIN_NS, int(touched[-1]) + _MARGIN_NS
    shown_ns = -math.inf
    for frame in attempt.recording.frames(start_ns, end_ns):
        if frame.stamp_ns - shown_ns < 0.99e9 / FRAMES_PER_S:
            continue
        shown_ns, real = frame.stamp_ns, images.of(frame.jpeg)
        if real is None:
            continue
        measured = float(np.interp(frame.stamp_ns, force.stamp_ns, curve.value))
        touches = touched[0] <= frame.stamp_ns <= touched[-1]
        goal = Goal(stamp_s=frame.stamp_ns * 1e-9, force_n=measured if touches else 0.0)
        row = _row(goal, (frame.stamp_ns - start_ns) * 1e-9, twin, real, background)
        yield row | {"measured_n": measured}


def _lasting(touching: np.ndarray[Any, np.dtype[np.bool_]]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return the longest stretch without a gap: a cell's noise touches for a sample or two."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching, [False]]).astype(int)))
    kept = np.zeros_like(touching)
    stretches = list(pairwise(edges.tolist()))[::2]
    if stretches:
        start, stop = max(stretches, key=lambda each: each[1] - each[0])
        kept[start:stop] = True
    return kept


def _row(
    goal: Goal, time_s: float, twin: Twin, real: ImageArray, background: ImageArray
) -> dict[str, Any]:
    made = twin.follower.follow(goal)
    maps = maps_of(made)
    residual = contact_residual(real, made.image, background) if made.force_n else None
    return {
        "time_s": round(time_s, 3),
        "force_n": made.force_n,
        "error_n": made.force_error_n,
        "depth_mm": 1e3 * made.depth_m,
        "residual": residual,
        **{f"{name}_kpa": most_kpa for name, (most_kpa, _) in maps.items()},
        "note": made.note,
        "real": _uri(jpeg_of(real)),
        "twin": _uri(jpeg_of(made.image)),
        **{name: _uri(drawn) for name, (_, drawn) in maps.items()},
    }


def _uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode("ascii")
