"""What the benchmark measured, as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from sim.studies.bench.growth import EXPONENT_WANTED, exponent, local_exponents
from sim.studies.bench.rendering import BATCH, BLUR_PX, SAMPLES
from sim.studies.bench.replays import FORCE_ERROR_MAX as REPLAY_ERROR_MAX
from sim.studies.bench.replays import MEMORY_MAX_MIB, TIME_MAX_S
from sim.studies.bench.start import HELP_MAX_S, PRESS_MAX_S
from sim.studies.bench.suite import Benchmark
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of

# Of an image [ms].
_ONE_MS, _OF_A_BATCH_MS = 5.0, 0.2
# 5,550 frames a second, ten times the paper's (with stress, GPU), leave as much for all of a frame.
_FROM_NODES_MS = 0.18
_prose = partial(table_prose, "sim.studies.bench", "tables.md.jinja")


def bench_tables(found: Benchmark) -> list[Table]:
    """Return the tables of what was measured, in the order of the page."""
    tables: dict[Callable[[Benchmark], Table], Sequence[object]] = {
        _rendering: found.rendering,
        _replays: found.replays,
        _growth: found.growth,
        _start: found.start,
        _threads: found.threads,
    }
    return [table(found) for table, rows in tables.items() if rows]


def _rendering(found: Benchmark) -> Table:
    limits = {"one by one": _ONE_MS, "batch": _OF_A_BATCH_MS, "from nodes": _FROM_NODES_MS}
    judged = [row for row in found.rendering if row.image_count in (1, BATCH)]
    return table_of(
        found.rendering,
        {
            "sensor": lambda row: row.sensor,
            "renderer": lambda row: row.renderer,
            "device": lambda row: row.device,
            "images": lambda row: row.image_count,
            "samples": lambda row: f"{row.samples}x{row.samples}",
            "shadows": lambda row: row.shadow_count,
            "image [ms]": lambda row: row.image_ms,
            "least [ms]": lambda row: 1e3 * row.least_s / row.image_count,
            "apart [levels]": lambda row: row.apart_levels,
            "apart [%]": lambda row: 1e2 * row.apart_share,
        },
        passed=all(row.image_ms < limits[row.renderer] for row in judged)
        and all(row.apart_levels <= 1 for row in found.rendering),
        **_prose(
            "rendering",
            one_ms=_ONE_MS,
            of_a_batch_ms=_OF_A_BATCH_MS,
            from_nodes_ms=_FROM_NODES_MS,
            batch=BATCH,
            first=found.rendering[0],
            blur_px=f"{BLUR_PX:g}",
            samples=SAMPLES,
            absent=found.absent,
        ),
    )


def _replays(found: Benchmark) -> Table:
    within = [row for row in found.replays if row.is_within]
    return table_of(
        found.replays,
        {
            "preset": lambda row: row.setting,
            "presses": lambda row: row.trial_count,
            "F_z believed within [%]": lambda row: (
                None if row.force_error is None else 1e2 * row.force_error
            ),
            "iterations": lambda row: row.newton_iterations,
            "presses and fields [s]": lambda row: row.presses_s,
            "images [s]": lambda row: row.images_s,
            "together [s]": lambda row: row.wall_s,
            "peak memory [MiB]": lambda row: row.memory_mib,
        },
        passed=any(row.wall_s < TIME_MAX_S and row.memory_mib < MEMORY_MAX_MIB for row in within),
        **_prose(
            "replays",
            error_max=REPLAY_ERROR_MAX,
            time_max_s=TIME_MAX_S,
            memory_max_mib=MEMORY_MAX_MIB,
            samples=SAMPLES,
        ),
    )


def _growth(found: Benchmark) -> Table:
    sizes = [float(row.tet_count) for row in found.growth]
    spent = [row.cpu_s for row in found.growth]
    each = [row.cpu_s / row.newton_iterations for row in found.growth]
    power = exponent(sizes, spent)
    steps = [None, *local_exponents(sizes, spent)]
    return table_of(
        list(zip(found.growth, each, steps, strict=True)),
        {
            "edges shorter by": lambda row: row[0].refinement,
            "tetrahedra": lambda row: row[0].tet_count,
            "nodes": lambda row: row[0].node_count,
            "iterations": lambda row: row[0].newton_iterations,
            "processor time [s]": lambda row: row[0].cpu_s,
            "of an iteration [ms]": lambda row: 1e3 * row[1],
            "exponent from the row above": lambda row: row[2],
        },
        passed=power <= EXPONENT_WANTED,
        **_prose(
            "growth",
            wanted=EXPONENT_WANTED,
            power=f"{power:.2f}",
            of_one=f"{exponent(sizes, each):.2f}",
        ),
    )


def _start(found: Benchmark) -> Table:
    return table_of(
        found.start,
        {
            "what": lambda row: row.what,
            "processor time [s]": lambda row: row.cpu_s,
            "time [s]": lambda row: row.wall_s,
            "at most [s]": lambda row: row.limit_s,
        },
        passed=all(row.limit_s is None or row.cpu_s < row.limit_s for row in found.start),
        **_prose("start", help_max=HELP_MAX_S, press_max=PRESS_MAX_S),
    )


def _threads(found: Benchmark) -> Table:
    return table_of(
        found.threads,
        {
            "unknowns": lambda row: row.unknown_count,
            "threads": lambda row: row.thread_count,
            "factor [ms]": lambda row: 1e3 * row.factor_s,
            "processor time of it [ms]": lambda row: 1e3 * row.factor_cpu_s,
            "solution [ms]": lambda row: 1e3 * row.solve_s,
            "processor time of that [ms]": lambda row: 1e3 * row.solve_cpu_s,
        },
        **_prose("threads"),
    )
