"""Twenty frames of a travel of 1 mm into a gel: how many a second, and what each reuse saves."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from sim.effects.plan import plan_effects
from sim.effects.presets import build_model
from sim.error.measured_errors import FAST, Setting
from sim.press import path_for
from sim.scene.scene import Preset, Scene, Target
from sim.solve.equilibrium import NEWTON, Reuse, SolverOptions
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model

_KIB, _MIB = 1024.0, 1024.0**2
TRAVEL_M = 1e-3
FRAME_COUNT = 20
FORCE_ERROR_MAX = 0.03
# Preset accurate, which F_z is compared with, may itself be 1 % above the limit of fine meshes.
CLOSE = 0.02
# Tried one after the other until F_z is close enough.
SETTINGS = (FAST, *(Setting(Preset.FAST, k) for k in (1.2, 1.4, 1.7)), Setting(Preset.BALANCED))
_REPEATS = 10
_OPTIONS = SolverOptions(residual_relative=1e-6)
_STUBBORN = ((60, 0.0),)
_NEVER = 10**9
# The first is preset fast as it is.
WAYS: dict[str, Reuse] = {
    "factors kept, steps remembered": Reuse(),
    "no steps remembered": Reuse(memory=0),
    "a factor for every frame": Reuse(evaluations_max=0),
    "a factor renewed only after 60 steps": Reuse(evaluations_max=_NEVER, patience=_STUBBORN),
    "Newton's method, a factor for every step": NEWTON,
}
ONE_PATH, EACH_ANEW = "the replay's forces on one path", "the replay's forces each anew"


def peak_memory_mib() -> float:
    """Return the largest resident set so far [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1.0 if sys.platform == "darwin" else _KIB) / _MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedFrames:
    """A travel in frames on one mesh, in one environment or many side by side.

    Attributes:
        wall_s: All frames of all environments, the least of several [s].
        force_error: F_z of the last frame in the first environment over that of preset accurate,
            less one.
    """

    tet_count: int
    unknown_count: int
    wall_s: float = float("nan")
    force_error: float = float("nan")

    @property
    def frame_ms(self) -> float:
        """Time of a frame of all environments [ms]."""
        return 1e3 * self.wall_s / FRAME_COUNT

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments together [1/s]."""
        return FRAME_COUNT * self._travelling / self.wall_s

    @property
    def _travelling(self) -> int:
        """Environments whose frames count."""
        return 1


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow(TimedFrames):
    """What a travel took.

    Attributes:
        setting: Preset, and how much shorter than its own the edges are.
        newton_iterations: Steps towards equilibrium, all frames.
        factorisations: All frames.
        setup_s: Mesh, upload and symbolic factorisation [s].
        cpu_s: Processor time of all frames [s].
        memory_mib: The process's peak so far [MiB].
    """

    setting: str
    device: str
    newton_iterations: int
    factorisations: int
    setup_s: float
    cpu_s: float
    memory_mib: float


def travels(
    scene: Scene, *, exact_n: float, settings: Sequence[Setting] = SETTINGS
) -> Iterator[FrameRow]:
    """Travel with one setting after the other, until F_z is within 2 %.

    Args:
        exact_n: F_z that it is compared with [N].

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    for setting in settings:
        row = travel(scene, setting, exact_n=exact_n)
        yield row
        if abs(row.force_error) <= CLOSE:
            return


def travel(scene: Scene, setting: Setting, *, exact_n: float, repeats: int = _REPEATS) -> FrameRow:
    """Press 1 mm deep in frames of 0.05 mm; the kernels should be warm.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(setting.applied(scene), target=Target(depth_m=TRAVEL_M))
    plan = plan_effects(scene)
    started = time.perf_counter()
    path = path_for(scene, plan)
    setup_s = time.perf_counter() - started
    times = []
    for _ in range(repeats):
        path = path_for(scene, plan, model=path.model)
        ready, cpu = time.perf_counter(), time.process_time()
        point = _travel(path)
        times.append((time.perf_counter() - ready, time.process_time() - cpu))
    wall_s, cpu_s = min(times)
    return FrameRow(
        setting=str(setting),
        device=path.model.device,
        tet_count=len(path.model.elements),
        unknown_count=path.model.pattern.dof_count,
        newton_iterations=path.counts.newton_iterations,
        factorisations=path.solver.factor.made,
        setup_s=setup_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        force_error=float(point.force_n[2]) / exact_n - 1.0,
        memory_mib=peak_memory_mib(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReuseRow:
    """What a travel or a replay took.

    Attributes:
        evaluations: Of the forces.
        cpu_s: Processor time, mesh and set-up not included [s].
    """

    way: str
    evaluations: int
    factorisations: int
    cpu_s: float
    force_n: float


def measure_reuse(
    scene: Scene, forces_n: Sequence[float], *, ways: Sequence[str] = tuple(WAYS)
) -> Iterator[ReuseRow]:
    """Press 1 mm deep in 20 frames with preset fast, in one way after the other.

    Args:
        forces_n: Of a replay [N], which is then made on one path and on one path a force.
        ways: Names of ``WAYS``.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(scene, preset=Preset.FAST, target=Target(depth_m=TRAVEL_M))
    model = build_model(scene)
    for name in ways:
        yield _timed(name, [_path(scene, model, WAYS[name])], [_travel])
    ordered = sorted(forces_n)
    one = [_path(scene, model, Reuse())] * len(ordered)
    anew = [_path(scene, model, Reuse()) for _ in ordered]
    for name, paths in ((ONE_PATH, one), (EACH_ANEW, anew)):
        yield _timed(name, paths, [partial(LoadingPath.push, force_n=force) for force in ordered])


def _path(scene: Scene, model: Model, reuse: Reuse) -> LoadingPath:
    return LoadingPath(model, scene.indenter, scene.centre_m, options=_OPTIONS, reuse=reuse)


def _travel(path: LoadingPath) -> PathPoint:
    """Press 1 mm deep in frames, and return the last."""
    depths = [TRAVEL_M * frame / FRAME_COUNT for frame in range(1, FRAME_COUNT + 1)]
    return [path.advance(depth) for depth in depths][-1]


def _timed(
    way: str, paths: Sequence[LoadingPath], moves: Sequence[Callable[[LoadingPath], object]]
) -> ReuseRow:
    """Make every move on its path; a path may serve several."""
    spent = time.process_time()
    for path, move in zip(paths, moves, strict=True):
        move(path)
    spent = time.process_time() - spent
    distinct = {id(path): path for path in paths}.values()
    last = paths[-1].last
    return ReuseRow(
        way=way,
        evaluations=sum(path.solver.evaluations for path in distinct),
        factorisations=sum(path.solver.factor.made for path in distinct),
        cpu_s=spent,
        force_n=0.0 if last is None else float(last.force_n[2]),
    )
