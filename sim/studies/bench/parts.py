"""What a replay, growth with elements, start-up and a factor's threads take, as rows and tables."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error import Tolerance, keeping, setting_of
from sim.fields.surface import SurfaceState
from sim.mesh.discretisation import SparsePattern
from sim.replay import replay_forces, replay_scene
from sim.scene.scene import Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.linear_solver import linear_solver
from sim.studies.bench.rendering import SAMPLES
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.figure_style import BLUE, GREY, INK, PAGE_IN
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

Row = dict[str, Any]
"""A row by the headings of its table, units in brackets."""
ImageOf = Callable[[SurfaceState], ImageArray]

FORCE_ERROR_MAX, TIME_MAX_S = 0.02, 20.0
_KIB, _MIB = 1024.0, 1024.0**2
MEMORY_MAX_MIB = 2e9 / _MIB
BELIEVED = "F_z believed within [%]"
REFINEMENTS, EXPONENT_WANTED = (0.7, 1.0, 1.4, 2.0, 2.5), 1.5
# What an operator does not notice, and what is little beside a press [s of the processor].
HELP_MAX_S, PRESS_MAX_S = 0.4, 1.5
_REPEATS = 3
_HELP = (("--version",), ("--help",), ("press", "--help"), ("study", "bench", "--help"))
# Says the processor and wall time of a second press: the first also pays for what both need.
_TWO_PRESSES = """
import time
from sim.press import press
from sim.press_command import scene_from
scene = scene_from(
    "--sensor gelsight-mini --indenter sphere:diameter=10mm --depth 0.05mm --preset fast"
)
press(scene)
cpu, wall = time.process_time(), time.perf_counter()
press(scene)
print(time.process_time() - cpu, time.perf_counter() - wall)
"""
# Warp's own: where compiled kernels are kept.
_CACHE = "WARP_CACHE_PATH"
# Edges so much shorter than those of preset fast: a few thousand unknowns to some ten thousand.
THREAD_REFINEMENTS = (1.0, 1.6, 2.2, 2.8, 3.4)
_BUDGET_S = 2.0
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


def measure_growth(
    scene: Scene, *, depth_m: float, refinements: Sequence[float] = REFINEMENTS
) -> Iterator[Row]:
    """Press a scene on finer and finer meshes of its preset, all other settings the same."""
    for refinement in refinements:
        wall, cpu = time.perf_counter(), time.process_time()
        path = path_for(scene, plan_effects(scene), refinement=refinement)
        path.advance(depth_m)
        yield {
            "edges shorter by": refinement,
            "tetrahedra": len(path.model.elements),
            "nodes": len(path.model.nodes),
            "iterations": path.counts.newton_iterations,
            "processor time [s]": time.process_time() - cpu,
            "time [s]": time.perf_counter() - wall,
        }


def growth_table(rows: Sequence[Row]) -> Table:
    """Return the growth, with the exponent through all rows and between neighbours."""
    sizes, spent = _grown(rows)
    each = [row["processor time [s]"] / row["iterations"] for row in rows]
    power, steps = exponent(sizes, spent), [None, *local_exponents(sizes, spent)]
    shown = [
        {**row, "of an iteration [ms]": 1e3 * one, "exponent from the row above": step}
        for row, one, step in zip(rows, each, steps, strict=True)
    ]
    found = {"power": f"{power:.2f}", "of_one": f"{exponent(sizes, each):.2f}"}
    prose = _prose("growth", wanted=EXPONENT_WANTED, **found)
    return table_of_rows(shown, passed=power <= EXPONENT_WANTED, **prose)


def _grown(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    return [float(row["tetrahedra"]) for row in rows], [row["processor time [s]"] for row in rows]


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Return p of the power law time = c size^p that fits best, in logarithms."""
    slope, _ = np.polyfit(np.log(sizes), np.log(times), 1)
    return float(slope)


def local_exponents(sizes: Sequence[float], times: Sequence[float]) -> list[float]:
    """Return p between neighbouring sizes."""
    return [float(step) for step in np.diff(np.log(times)) / np.diff(np.log(sizes))]


def growth_figure(rows: Sequence[Row]) -> Figure:
    """Draw how presses grow with their elements."""
    sizes, times = _grown(rows)
    fitted = exponent(sizes, times)
    middle = np.exp(np.log(sizes).mean()), np.exp(np.log(times).mean())
    figure = Figure(figsize=(0.6 * PAGE_IN, 2.6), layout="constrained")
    axes = figure.add_subplot()
    axes.loglog(sizes, times, "o", color=BLUE, markersize=4)
    for power, style, colour, text in (
        (fitted, "-", INK, f"$n^{{{fitted:.2f}}}$, fitted"),
        (EXPONENT_WANTED, ":", GREY, f"$n^{{{EXPONENT_WANTED:g}}}$"),
    ):
        line = middle[1] * (np.array(sizes) / middle[0]) ** power
        axes.loglog(sizes, line, style, color=colour, label=text)
    # The measured places of the axis are labelled, and no others.
    axes.set_xticks(sizes, [f"{place:.0f}" for place in sizes])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="Tetrahedra $n$", ylabel="Processor time of a press (s)")
    axes.set_title("Growth with elements", loc="left")
    axes.legend()
    return figure


def measure_start() -> Iterator[Row]:
    """Measure the start of commands and of a press, the kernels compiled, then not."""
    for words in _HELP:
        command = [sys.executable, "-m", "tacauchy_rig.app.cli.app", *words]
        spent = min(process_spent(command)[:2] for _ in range(_REPEATS))
        yield _start_row(" ".join(words), *spent, HELP_MAX_S)
    warm = min(_until_a_press() for _ in range(_REPEATS))
    yield _start_row("until a press", *warm, PRESS_MAX_S)
    with TemporaryDirectory() as empty:
        cold = _until_a_press({_CACHE: empty})
    yield _start_row("compiling kernels once", cold[0] - warm[0], cold[1] - warm[1], None)


def _start_row(what: str, cpu_s: float, wall_s: float, limit_s: float | None) -> Row:
    spent = {"processor time [s]": cpu_s, "time [s]": wall_s}
    return {"what": what, **spent, "at most [s]": limit_s}


def start_table(rows: Sequence[Row]) -> Table:
    """Return what passes before work begins; where there is a limit, it is the processor's."""
    limits = [(row["processor time [s]"], row["at most [s]"]) for row in rows]
    passed = all(limit is None or spent < limit for spent, limit in limits)
    prose = _prose("start", help_max=HELP_MAX_S, press_max=PRESS_MAX_S)
    return table_of_rows(rows, passed=passed, **prose)


def _until_a_press(environment: dict[str, str] | None = None) -> tuple[float, float]:
    """Return processor and wall time of a process that presses twice, less twice the second."""
    cpu_s, wall_s, printed = process_spent([sys.executable, "-c", _TWO_PRESSES], environment)
    again_cpu_s, again_wall_s = (float(word) for word in printed.split())
    return cpu_s - 2.0 * again_cpu_s, wall_s - 2.0 * again_wall_s


def process_spent(
    command: Sequence[str], environment: dict[str, str] | None = None
) -> tuple[float, float, str]:
    """Return processor time and time of a process [s], and what it printed."""

    def children_s() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before, begun = children_s(), time.perf_counter()
    own = os.environ | (environment or {})
    done = subprocess.run(command, env=own, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RigError(
            f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()}",
            remedy="run it by itself",
        )
    return children_s() - before, time.perf_counter() - begun, done.stdout


def measure_threads(
    scene: Scene, *, refinements: Sequence[float] = THREAD_REFINEMENTS
) -> Iterator[Row]:
    """Factor matrices of finer and finer meshes of a scene with one thread, and with all cores."""
    scene = replace(scene, preset=Preset.FAST)
    for refinement in refinements:
        pattern = path_for(scene, plan_effects(scene), refinement=refinement).model.pattern
        for count in sorted({1, 2, min(4, len(os.sched_getaffinity(0)))}):
            # MKL reads the variable once, and Pardiso takes one number of threads to its end.
            with ProcessPoolExecutor(
                1, mp_context=get_context("spawn"), initializer=_choose, initargs=(count,)
            ) as own:
                yield own.submit(_factored, pattern, count).result()


def threads_table(rows: Sequence[Row]) -> Table:
    """Return what threads gain a factor, and cost."""
    return table_of_rows(rows, **_prose("threads"))


def _choose(count: int) -> None:
    os.environ["MKL_NUM_THREADS"] = str(count)


def _factored(pattern: SparsePattern, count: int) -> Row:
    # A stiff diagonal: Pardiso's work depends on the pattern alone.
    values = np.full(len(pattern.indices), -1e-3)
    values[pattern.indptr[:-1]] = 1.0
    right, solver = np.ones(pattern.dof_count), linear_solver(pattern)
    factor, factor_cpu = work_spent(lambda: solver.factorise(values))
    solve, solve_cpu = work_spent(lambda: solver.solve(right))
    return {
        "unknowns": pattern.dof_count,
        "threads": count,
        "factor [ms]": 1e3 * factor,
        "processor time of it [ms]": 1e3 * factor_cpu,
        "solution [ms]": 1e3 * solve,
        "processor time of that [ms]": 1e3 * solve_cpu,
    }


def work_spent(work: Callable[[], object]) -> tuple[float, float]:
    """Return the least time, and the mean processor time, of what fits in the budget [s].

    Some hosts count processor time in ticks that are longer than a small factor takes: the least
    of many would be zero there.
    """
    walls: list[float] = []
    begin, cpu = time.perf_counter(), time.process_time()
    while not walls or time.perf_counter() - begin < _BUDGET_S:
        wall = time.perf_counter()
        work()
        walls.append(time.perf_counter() - wall)
    return min(walls), (time.process_time() - cpu) / len(walls)
