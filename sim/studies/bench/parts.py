"""What a replay, growth with elements, start-up and a factor's threads take."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.context import SpawnContext
from tempfile import TemporaryDirectory

import numpy as np

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error.settings import setting_of
from sim.error.tolerance import Tolerance, keeping
from sim.fields.surface import SurfaceState
from sim.mesh.sparsity import SparsePattern
from sim.replay import replay_forces, replay_scene
from sim.scene.scene import Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.linear_solver import linear_solver
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RigError


def times_of(act: Callable[[], object], *, most: int, least: int, budget_s: float) -> list[float]:
    """Repeat something after once to warm up, and return how long each time took [s].

    Args:
        most: Repeats.
        least: Repeats that are made however long they take.
        budget_s: Begin no more once so much was spent [s].
    """
    act()
    times: list[float] = []
    while len(times) < most and (len(times) < least or sum(times) < budget_s):
        started = time.perf_counter()
        act()
        times.append(time.perf_counter() - started)
    return times


FORCE_ERROR_MAX = 0.02
TIME_MAX_S = 20.0
_KIB, _MIB = 1024.0, 1024.0**2
MEMORY_MAX_MIB = 2e9 / _MIB

ImageOf = Callable[[SurfaceState], ImageArray]


def peak_memory_mib() -> float:
    """Return the largest resident set so far [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1.0 if sys.platform == "darwin" else _KIB) / _MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRow:
    """A replay of a run's forces.

    Attributes:
        setting: A preset, or a mesh between two.
        presses_s: Mesh, presses and fields [s].
        images_s: Height maps and images of all trials [s].
        force_error: Believed relative error of F_z, the largest; None where nothing is known.
        memory_mib: The process's peak so far [MiB].
    """

    setting: str
    trial_count: int
    newton_iterations: int
    presses_s: float
    images_s: float
    force_error: float | None
    memory_mib: float

    @property
    def wall_s(self) -> float:
        """All of it [s]."""
        return self.presses_s + self.images_s

    @property
    def is_within(self) -> bool:
        """F_z is believed to within 2 %."""
        return self.force_error is not None and self.force_error <= FORCE_ERROR_MAX


def measure_replay(
    scene: Scene,
    forces_n: Sequence[float],
    image_of: ImageOf,
    *,
    tolerance: Tolerance | None = None,
) -> ReplayRow:
    """Replay forces [N] on a scene's sensor and indenter.

    Args:
        scene: Its preset counts where there is no tolerance.
        image_of: Makes the image of a pressed surface, from its height maps on.
        tolerance: Of F_z; the cheapest settings that promise it are taken, and choosing them is in
            the time.

    Raises:
        ConfigError: No settings promise the tolerance.
        ConvergenceError: A force cannot be reached.
    """
    started = time.perf_counter()
    sensor = load_sensor(scene.sensor)
    asked = replay_scene(sensor, scene.indenter, forces_n, preset=scene.preset)
    if tolerance is not None:
        asked = keeping(asked, tolerance)
    found, fields = replay_forces(asked, forces_n)
    pressed = time.perf_counter()
    for trial in fields:
        image_of(trial.surface)
    errors = [trial.force_error_estimate for trial in found.trials]
    known = [error for error in errors if error is not None]
    return ReplayRow(
        setting=str(setting_of(asked)),
        trial_count=len(found.trials),
        newton_iterations=sum(trial.newton_iterations for trial in found.trials),
        presses_s=pressed - started,
        images_s=time.perf_counter() - pressed,
        force_error=max(known) if len(known) == len(errors) else None,
        memory_mib=peak_memory_mib(),
    )


REFINEMENTS = (0.7, 1.0, 1.4, 2.0, 2.5)
EXPONENT_WANTED = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthRow:
    """A press on one mesh.

    Attributes:
        refinement: Every edge this many times shorter than the preset's.
        cpu_s: Processor time, mesh included [s].
    """

    refinement: float
    tet_count: int
    node_count: int
    newton_iterations: int
    wall_s: float
    cpu_s: float


def growth(
    scene: Scene, *, depth_m: float, refinements: Sequence[float] = REFINEMENTS
) -> list[GrowthRow]:
    """Press a scene on finer and finer meshes of its preset, all other settings the same.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    return [_grown(scene, depth_m, refinement) for refinement in refinements]


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Return p of the power law time = c size^p that fits best, in logarithms."""
    slope, _ = np.polyfit(np.log(sizes), np.log(times), 1)
    return float(slope)


def local_exponents(sizes: Sequence[float], times: Sequence[float]) -> list[float]:
    """Return p between neighbouring sizes."""
    steps = np.diff(np.log(times)) / np.diff(np.log(sizes))
    return [float(step) for step in steps]


def _grown(scene: Scene, depth_m: float, refinement: float) -> GrowthRow:
    wall, cpu = time.perf_counter(), time.process_time()
    path = path_for(scene, plan_effects(scene), refinement=refinement)
    path.advance(depth_m)
    return GrowthRow(
        refinement=refinement,
        tet_count=len(path.model.elements),
        node_count=len(path.model.nodes),
        newton_iterations=path.counts.newton_iterations,
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
    )


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


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRow:
    """What passes before work begins.

    Attributes:
        cpu_s: Processor time [s].
        wall_s: Time [s].
        limit_s: Of the processor time; None where nothing is demanded.
    """

    what: str
    cpu_s: float
    wall_s: float
    limit_s: float | None = None


def measure_start() -> list[StartRow]:
    """Measure the start of commands and of a press, the kernels compiled, then not.

    Raises:
        RigError: One of them fails.
    """
    rows = []
    for words in _HELP:
        cpu_s, wall_s = min(_process_spent(_program(words))[:2] for _ in range(_REPEATS))
        rows.append(StartRow(what=" ".join(words), cpu_s=cpu_s, wall_s=wall_s, limit_s=HELP_MAX_S))
    warm = min(_until_a_press() for _ in range(_REPEATS))
    rows.append(StartRow(what="until a press", cpu_s=warm[0], wall_s=warm[1], limit_s=PRESS_MAX_S))
    with TemporaryDirectory() as empty:
        cold = _until_a_press({_CACHE: empty})
    compiling = (cold[0] - warm[0], cold[1] - warm[1])
    return [*rows, StartRow(what="compiling kernels once", cpu_s=compiling[0], wall_s=compiling[1])]


def _program(words: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "tacauchy_rig.app.cli.app", *words]


def _until_a_press(environment: dict[str, str] | None = None) -> tuple[float, float]:
    """Return processor and wall time of a process that presses twice, less twice the second."""
    cpu_s, wall_s, told = _process_spent([sys.executable, "-c", _TWO_PRESSES], environment)
    again_cpu_s, again_wall_s = (float(word) for word in told.split())
    return cpu_s - 2.0 * again_cpu_s, wall_s - 2.0 * again_wall_s


def _process_spent(
    command: Sequence[str], environment: dict[str, str] | None = None
) -> tuple[float, float, str]:
    """Return processor time and time of a process [s], and what it printed."""
    before, begun = _children_s(), time.perf_counter()
    done = subprocess.run(
        command,
        env=os.environ | (environment or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RigError(
            f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()}",
            remedy="run it by itself",
        )
    return _children_s() - before, time.perf_counter() - begun, done.stdout


def _children_s() -> float:
    """Return the processor time of all processes that this one has waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


# Edges so much shorter than those of preset fast: a few thousand unknowns to some ten thousand.
THREAD_REFINEMENTS = (1.0, 1.6, 2.2, 2.8, 3.4)
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
    scene: Scene, *, refinements: Sequence[float] = THREAD_REFINEMENTS
) -> list[ThreadsRow]:
    """Factor matrices of finer and finer meshes of a scene with one thread, and with all cores."""
    scene = replace(scene, preset=Preset.FAST)
    counts = sorted({1, 2, min(4, len(os.sched_getaffinity(0)))})
    patterns = [
        path_for(scene, plan_effects(scene), refinement=each).model.pattern for each in refinements
    ]
    return [row for pattern in patterns for row in _thread_rows(pattern, counts)]


def _thread_rows(pattern: SparsePattern, counts: Sequence[int]) -> Iterator[ThreadsRow]:
    for count in counts:
        # MKL reads the variable once, and Pardiso takes one number of threads from end to end.
        with ProcessPoolExecutor(
            1, mp_context=_SPAWN, initializer=_choose, initargs=(count,)
        ) as own:
            yield own.submit(_factored, pattern, count).result()


def _choose(count: int) -> None:
    os.environ["MKL_NUM_THREADS"] = str(count)


def _factored(pattern: SparsePattern, count: int) -> ThreadsRow:
    # A stiff diagonal: Pardiso's work depends on the pattern alone.
    values = np.full(len(pattern.indices), -1e-3)
    values[pattern.indptr[:-1]] = 1.0
    right = np.ones(pattern.dof_count)
    solver = linear_solver(pattern)
    factor_s, factor_cpu_s = _work_spent(lambda: solver.factorise(values))
    solve_s, solve_cpu_s = _work_spent(lambda: solver.solve(right))
    return ThreadsRow(
        unknown_count=pattern.dof_count,
        thread_count=count,
        factor_s=factor_s,
        factor_cpu_s=factor_cpu_s,
        solve_s=solve_s,
        solve_cpu_s=solve_cpu_s,
    )


def _work_spent(work: Callable[[], object]) -> tuple[float, float]:
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
