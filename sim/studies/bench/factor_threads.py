"""What threads gain a factor, and cost: over unknowns, with one thread and with more."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.context import SpawnContext

import numpy as np

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.mesh.sparsity import SparsePattern
from sim.scene.scene import Preset, Scene
from sim.solve.linear_solver import linear_solver

# Edges so much shorter than those of preset fast: a few thousand unknowns to some ten thousand.
REFINEMENTS = (1.0, 1.6, 2.2, 2.8, 3.4)
_BUDGET_S = 2.0
_SPAWN: SpawnContext = get_context("spawn")


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreadsRow:
    """One size with one number of threads [s]: the least time, and processor time's mean."""

    unknown_count: int
    thread_count: int
    factor_s: float
    factor_cpu_s: float
    solve_s: float
    solve_cpu_s: float


def measure_threads(
    scene: Scene, *, refinements: Sequence[float] = REFINEMENTS
) -> list[ThreadsRow]:
    """Factor matrices of finer and finer meshes of a scene with one thread, and with all cores."""
    scene = replace(scene, preset=Preset.FAST)
    counts = sorted({1, 2, min(4, len(os.sched_getaffinity(0)))})
    patterns = [
        path_for(scene, plan_effects(scene), refinement=each).model.pattern for each in refinements
    ]
    return [row for pattern in patterns for row in _rows(pattern, counts)]


def _rows(pattern: SparsePattern, counts: Sequence[int]) -> Iterator[ThreadsRow]:
    for count in counts:
        # MKL reads the variable once, and Pardiso takes one number of threads from end to end.
        with ProcessPoolExecutor(
            1, mp_context=_SPAWN, initializer=_choose, initargs=(count,)
        ) as own:
            yield own.submit(_measured, pattern, count).result()


def _choose(count: int) -> None:
    os.environ["MKL_NUM_THREADS"] = str(count)


def _measured(pattern: SparsePattern, count: int) -> ThreadsRow:
    # A stiff diagonal: Pardiso's work depends on the pattern alone.
    values = np.full(len(pattern.indices), -1e-3)
    values[pattern.indptr[:-1]] = 1.0
    right = np.ones(pattern.dof_count)
    solver = linear_solver(pattern)
    factor_s, factor_cpu_s = _spent(lambda: solver.factorise(values))
    solve_s, solve_cpu_s = _spent(lambda: solver.solve(right))
    return ThreadsRow(
        unknown_count=pattern.dof_count,
        thread_count=count,
        factor_s=factor_s,
        factor_cpu_s=factor_cpu_s,
        solve_s=solve_s,
        solve_cpu_s=solve_cpu_s,
    )


def _spent(work: Callable[[], object]) -> tuple[float, float]:
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
