"""A sweep: what is missing is computed, and what there is becomes a data set."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.sweep.engines import Engine
from tacauchy_rig.app.sweep.metadata import write_datasheet
from tacauchy_rig.app.sweep.plan import Plan, Row, row_hash, sensor_of
from tacauchy_rig.app.sweep.resume_index_and_splits import done_rows, write_index
from tacauchy_rig.app.sweep.shards import SHARDS, make_shard, parquet, shards_of
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import data_url, decode_rgb, encode_jpeg
from tacauchy_rig.core.markdown_page import environment_of
from tacauchy_rig.core.store.atomic_write import free_bytes, write_atomically
from tacauchy_rig.core.time_limit_and_progress import doing
from tacauchy_rig.core.versions import library

SHOWN = 50
"""Images on the page."""
_QUALITY = 80
_NAMED = ("sensor", "indenter", "object")
_TARGETS = ("depth_m", "force_n")
_VARIED = tuple(f"commanded_{name}" for name in _TARGETS)
_VARIED += tuple(each.name for each in fields(Row) if each.name not in (*_NAMED, *_TARGETS))
_FOUND = ("force_x_n", "force_y_n", "force_z_n", "contact_radius_m")
_SLOWEST = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Swept:
    """What a call of ``sweep`` did.

    Attributes:
        is_whole: All rows are there; of a folder that several tasks share, others may have some.
        presses: How many it computed.
        elapsed_s: Wall clock from the first press to the last [s], with the start of processes.
        took_s: Of it, in ``setup``, ``solve``, ``render`` and ``write``; summed over processes [s].
        peaks_bytes: Of each shard in their order, the most memory that its process had used so far.
    """

    is_whole: bool
    presses: int
    elapsed_s: float
    took_s: dict[str, float]
    peaks_bytes: list[float]


def write_summary(folder: Path, plan: Plan, table: Any, swept: Swept) -> None:
    """Write the page of an index's table."""
    rows = table.to_pylist()
    good = [row for row in rows if row["valid"]]
    errors = np.array([row["force_error"] for row in good] or [np.nan])
    reasons = [row["reason"] for row in rows if not row["valid"]]
    facts = {
        "name": plan.dataset.name,
        "rows": rows,
        "valid": len(good),
        "failures": {reason: reasons.count(reason) for reason in sorted(set(reasons))},
        "ranges": [_range(name, rows) for name in _VARIED]
        + [_range(name, good) for name in _FOUND],
        "objects": _counts(rows, "object"),
        "sensors": _counts(rows, "sensor"),
        "errors": [(f"{part} %", np.percentile(errors, part)) for part in (50, 95, 100)],
        "tolerance": plan.simulation.tolerance,
        "within": float(np.mean(errors <= plan.simulation.tolerance)),
        "slowest": sorted(rows, key=lambda row: -row["evaluations"])[:_SLOWEST],
        "images": _images(folder, rows),
        "swept": swept,
    }
    page = environment_of("tacauchy_rig.app.sweep", ".").get_template("summary.html.jinja")
    write_atomically(folder / "summary.html", page.render(**facts).encode())


def _range(name: str, rows: list[dict[str, Any]]) -> tuple[str, int, float, float]:
    values = [row[name] for row in rows if row[name] is not None]
    return name, len(set(values)), min(values, default=np.nan), max(values, default=np.nan)


def _counts(rows: list[dict[str, Any]], name: str) -> list[tuple[str, int, int, int]]:
    """Return of each value how many presses it has, how many are valid, and are tests by object."""
    found = []
    for value in sorted({row[name] for row in rows}):
        own = [row for row in rows if row[name] == value]
        tests = sum(row["split_object"] == "test" for row in own)
        found.append((value, len(own), sum(row["valid"] for row in own), tests))
    return found


def _images(folder: Path, rows: list[dict[str, Any]]) -> list[tuple[dict[str, Any], str]]:
    """Return some presses, evenly over the plan, with their images as data addresses."""
    chosen = [rows[k] for k in np.unique(np.linspace(0, len(rows) - 1, SHOWN).astype(int))]
    found = []
    for row in chosen:
        file = parquet().parquet.ParquetFile(folder / row["shard"])
        image = decode_rgb(file.read(columns=["image"])["image"][row["offset"]].as_py())
        assert image is not None  # noqa: S101 - a shard's own
        found.append((row, data_url(encode_jpeg(image, quality=_QUALITY))))
    return found


# Of one press on edges of 1.25 mm, without friction, on one core [s]; it goes with the number of
# elements. Friction and ways along the gel, triangles, and a tolerance of 5 % take so many times as
# long.
_PRESS_S, _EDGE_M, _MOVING, _TRIANGLES, _REPEATED = 1.0, 1.25e-3, 3.0, 3.0, 1.6
# Of both images and of the fields in a shard, for each pixel of the image.
_BYTES_PER_PIXEL, _NOISE_BYTES = 2.0, 5.0


def estimate(plan: Plan, rows: Sequence[Row]) -> tuple[float, float]:
    """Return what presses take, by others that were measured: time of one core [s], and bytes."""
    each_s = _PRESS_S * (_EDGE_M / plan.simulation.edge) ** 2
    each_s *= _REPEATED if plan.simulation.tolerance < 1.0 else 1.0
    seconds = size = 0.0
    for row in rows:
        moves, camera = row.friction or row.shift_x_m or row.shift_y_m, sensor_of(row.sensor).camera
        is_mesh = row.indenter.startswith(("mesh:", "object:"))
        seconds += each_s * (_MOVING if moves else 1.0) * (_TRIANGLES if is_mesh else 1.0)
        size += camera.width * camera.height * (_NOISE_BYTES if row.noise else _BYTES_PER_PIXEL)
    return seconds, size


def sweep(
    plan: Plan,
    rows: Sequence[Row],
    out: Path,
    engine: Engine,
    *,
    on_progress: Callable[[str, int, int, str], None] = lambda *_: None,
) -> Swept:
    """Compute the rows that are not in the folder yet; write index, datasheet and summary.

    Args:
        on_progress: Told what goes on, how many presses there are, how many there will be, and how
            long it takes still.

    Raises:
        ConfigError: A library that writes the datasheet is not installed.
        RecordError: The disk has no room, or a file is damaged.
    """
    for name in ("pyarrow", "mlcroissant", "rocrate"):
        library(name, extra="sweep")
    with doing("hashing presses"):
        named = {row_hash(row, plan.simulation): row for row in rows}
        done = done_rows(out)
    left = list(shards_of(plan, named, set(done)))
    missing = [row for shard in left for row in shard.rows]
    _check_space(out, estimate(plan, missing)[1])
    count, started, pressed = len(rows) - len(missing), time.monotonic(), 0
    took_s, peaks_bytes, elapsed_s = dict[str, float](), list[float](), 0.0
    on_progress("presses are done", count, len(rows), "")
    with doing(f"computing {len(missing)} missing presses"):
        for shard, made in engine(make_shard, left):
            begun = time.monotonic()
            write_atomically(out / SHARDS / f"{shard.name}.parquet", made.content)
            now = time.monotonic()
            for part, seconds in (*made.took_s.items(), ("write", now - begun)):
                took_s[part] = took_s.get(part, 0.0) + seconds
            peaks_bytes.append(made.peak_bytes)
            elapsed_s = now - started
            pressed += len(shard.rows)
            rate = pressed / elapsed_s
            left_s = (len(missing) - pressed) / rate
            told = f"about {left_s:.0f} s left" if left_s else ""
            on_progress(f"presses, {rate:.2g} a second", count + pressed, len(rows), told)
    whole = not set(named) - set(done_rows(out))
    swept = Swept(
        is_whole=whole, presses=pressed, elapsed_s=elapsed_s, took_s=took_s, peaks_bytes=peaks_bytes
    )
    if whole:
        with doing("writing index, datasheet and summary"):
            table = write_index(out, named)
            write_datasheet(out, plan, table)
            write_summary(out, plan, table, swept)
    return swept


def _check_space(out: Path, needed_bytes: float) -> None:
    try:
        free = free_bytes(out)
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror}", remedy="name another folder") from error
    if free < needed_bytes:
        raise RecordError(
            f"{out}: {free / 1e6:.1f} MB free; the presses need {needed_bytes / 1e6:.1f} MB",
            remedy="free some space, give --out another disk, or press fewer with --limit",
        )
