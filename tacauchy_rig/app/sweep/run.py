"""A sweep: what is missing is computed, and what there is becomes a data set."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.app.sweep.datasheet import write_datasheet
from tacauchy_rig.app.sweep.engines import Engine
from tacauchy_rig.app.sweep.files import SHARDS, done_rows, make_shard, write_index
from tacauchy_rig.app.sweep.plan import Plan
from tacauchy_rig.app.sweep.rows import Row, sensor_of
from tacauchy_rig.app.sweep.shard import hashed, shards_of
from tacauchy_rig.app.sweep.summary import write_summary
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.long_task import doing
from tacauchy_rig.core.store.durable import free_bytes, write_atomically

# Of one press on edges of 1.25 mm, without friction, on one core [s]; it goes with the number of
# elements. Friction and ways along the gel, triangles, and a tolerance of 5 % take so many times as
# long.
_PRESS_S, _EDGE_M, _MOVING, _TRIANGLES, _REPEATED = 1.0, 1.25e-3, 3.0, 3.0, 1.6
# Of both images and of the fields in a shard, for each pixel of the image.
_BYTES_PER_PIXEL, _NOISE_BYTES = 2.0, 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What rows are expected to take."""

    processor_s: float  # on one core [s]
    size_bytes: float  # on the disk


def estimate(plan: Plan, rows: Sequence[Row]) -> Estimate:
    """Estimate what presses take, by others that were measured."""
    each_s = _PRESS_S * (_EDGE_M / plan.simulation.edge) ** 2
    each_s *= _REPEATED if plan.simulation.tolerance < 1.0 else 1.0
    seconds = size = 0.0
    for row in rows:
        moves, camera = row.friction or row.shift_x_m or row.shift_y_m, sensor_of(row.sensor).camera
        is_mesh = row.indenter.startswith(("mesh:", "object:"))
        seconds += each_s * (_MOVING if moves else 1.0) * (_TRIANGLES if is_mesh else 1.0)
        size += camera.width * camera.height * (_NOISE_BYTES if row.noise else _BYTES_PER_PIXEL)
    return Estimate(processor_s=seconds, size_bytes=size)


def sweep(
    plan: Plan,
    rows: Sequence[Row],
    out: Path,
    engine: Engine,
    *,
    on_progress: Callable[[str, int, int, str], None] = lambda *_: None,
) -> bool:
    """Compute the rows that are not in the folder yet; write index, datasheet and summary.

    Args:
        on_progress: Told what goes on, how many presses there are, how many there will be, and how
            long it takes still.

    Returns:
        Whether all rows are there; of a folder that several tasks share, others may have some.

    Raises:
        RecordError: The disk has no room, or a file is damaged.
    """
    with doing("hashing presses"):
        named = hashed(plan, rows)
        done = done_rows(out)
    left = list(shards_of(plan, named, set(done)))
    missing = [row for shard in left for row in shard.rows]
    _check_space(out, estimate(plan, missing))
    count, started, pressed = len(rows) - len(missing), time.monotonic(), 0
    on_progress("presses are done", count, len(rows), "")
    with doing(f"computing {len(missing)} missing presses"):
        for shard, content in engine(make_shard, left):
            write_atomically(out / SHARDS / f"{shard.name}.parquet", content)
            pressed += len(shard.rows)
            rate = pressed / (time.monotonic() - started)
            left_s = (len(missing) - pressed) / rate
            told = f"about {left_s:.0f} s left" if left_s else ""
            on_progress(f"presses, {rate:.2g} a second", count + pressed, len(rows), told)
    if set(named) - set(done_rows(out)):
        return False
    with doing("writing index, datasheet and summary"):
        table = write_index(out, named)
        write_datasheet(out, plan, table)
        write_summary(out, plan, table)
    return True


def _check_space(out: Path, needed: Estimate) -> None:
    try:
        free = free_bytes(out)
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror}", remedy="name another folder") from error
    if free < needed.size_bytes:
        raise RecordError(
            f"{out}: {free / 1e6:.0f} MB free; the presses need {needed.size_bytes / 1e6:.0f} MB",
            remedy="free some space, give --out another disk, or press fewer with --limit",
        )
