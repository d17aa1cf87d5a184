"""What a replay takes, as rows and a table."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from sim.error import Tolerance, keeping, setting_of
from sim.fields.press_fields import SurfaceState
from sim.replay import replay_forces, replay_scene
from sim.scene.scene import Scene
from sim.sensor.sensor import load_sensor
from sim.studies.bench.rendering import SAMPLES
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

Row = dict[str, Any]
"""A row by the headings of its table, units in brackets."""
ImageOf = Callable[[SurfaceState], ImageArray]

FORCE_ERROR_MAX, TIME_MAX_S = 0.02, 20.0
_KIB, _MIB = 1024.0, 1024.0**2
MEMORY_MAX_MIB = 2e9 / _MIB
BELIEVED = "F_z believed within [%]"
_prose = partial(table_prose, "sim.studies.bench", "tables.md.jinja")


def peak_memory_mib() -> float:
    """Return the largest resident set so far [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1.0 if sys.platform == "darwin" else _KIB) / _MIB


def measure_replay(
    scene: Scene,
    forces_n: Sequence[float],
    image_of: ImageOf,
    *,
    tolerance: Tolerance | None = None,
) -> Row:
    """Replay forces [N] on a scene's sensor and indenter: mesh, presses, fields and images.

    With a tolerance of F_z the cheapest settings that state it are taken in place of the scene's
    preset, and choosing them is in the time.
    """
    started = time.perf_counter()
    asked = replay_scene(load_sensor(scene.sensor), scene.indenter, forces_n, preset=scene.preset)
    if tolerance is not None:
        asked = keeping(asked, tolerance)
    found, fields = replay_forces(asked, forces_n)
    pressed = time.perf_counter()
    for trial in fields:
        image_of(trial.surface)
    ended = time.perf_counter()
    errors = [trial.force_error_estimate for trial in found.trials]
    known = [error for error in errors if error is not None]
    return {
        "preset": str(setting_of(asked)),
        "presses": len(found.trials),
        BELIEVED: 1e2 * max(known) if len(known) == len(errors) else None,
        "iterations": sum(trial.newton_iterations for trial in found.trials),
        "presses and fields [s]": pressed - started,
        "images [s]": ended - pressed,
        "together [s]": ended - started,
        "peak memory [MiB]": peak_memory_mib(),
    }


def replay_table(rows: Sequence[Row]) -> Table:
    """Return the replays; one that is within 2 % has to be quick and small."""
    limits = {"time_max_s": TIME_MAX_S, "memory_max_mib": MEMORY_MAX_MIB}
    return table_of_rows(
        rows,
        passed=any(
            row[BELIEVED] is not None
            and row[BELIEVED] <= 1e2 * FORCE_ERROR_MAX
            and row["together [s]"] < TIME_MAX_S
            and row["peak memory [MiB]"] < MEMORY_MAX_MIB
            for row in rows
        ),
        **_prose("replays", error_max=FORCE_ERROR_MAX, samples=SAMPLES, **limits),
    )
