"""Frames a second: an indenter that travels 1 mm into a gel in 20 frames."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sim.effects.plan import plan_effects
from sim.error.settings import FAST, Setting
from sim.press import path_for
from sim.scene.scene import Preset, Scene, Target
from sim.studies.bench.memory import peak_memory_mib

TRAVEL_M = 1e-3
FRAME_COUNT = 20
FORCE_ERROR_MAX = 0.03
# Preset accurate, which F_z is compared with, may itself be 1 % above the limit of fine meshes.
CLOSE = 0.02
# Tried one after the other until F_z is close enough.
SETTINGS = (FAST, *(Setting(Preset.FAST, k) for k in (1.2, 1.4, 1.7)), Setting(Preset.BALANCED))
_REPEATS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow:
    """What a travel took.

    Attributes:
        setting: Preset, and how much shorter than its own the edges are.
        newton_iterations: Steps towards equilibrium, all frames.
        factorisations: All frames; None where every step makes one.
        setup_s: Mesh, upload and symbolic factorisation [s].
        wall_s: All frames, the least of ten [s].
        cpu_s: Processor time of the same [s].
        force_error: F_z of the last frame over that of preset accurate, less one.
        memory_mib: The process's peak so far [MiB].
    """

    setting: str
    device: str
    tet_count: int
    unknown_count: int
    newton_iterations: int
    factorisations: int | None
    setup_s: float
    wall_s: float
    cpu_s: float
    force_error: float
    memory_mib: float

    @property
    def frame_ms(self) -> float:
        """Time of a frame [ms]."""
        return 1e3 * self.wall_s / FRAME_COUNT

    @property
    def frames_per_s(self) -> float:
        """Frames a second [1/s]."""
        return FRAME_COUNT / self.wall_s


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


def travel(
    scene: Scene, setting: Setting, *, exact_n: float, device: str = "cpu", repeats: int = _REPEATS
) -> FrameRow:
    """Press 1 mm deep in frames of 0.05 mm; the kernels should be warm.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(setting.applied(scene), target=Target(depth_m=TRAVEL_M))
    plan = plan_effects(scene)
    started = time.perf_counter()
    path = path_for(scene, plan, device=device)
    setup_s = time.perf_counter() - started
    times = []
    for _ in range(repeats):
        path = path_for(scene, plan, model=path.model)
        ready, cpu = time.perf_counter(), time.process_time()
        for frame in range(1, FRAME_COUNT + 1):
            point = path.advance(TRAVEL_M * frame / FRAME_COUNT)
        times.append((time.perf_counter() - ready, time.process_time() - cpu))
    wall_s, cpu_s = min(times)
    return FrameRow(
        setting=str(setting),
        device=device,
        tet_count=len(path.model.elements),
        unknown_count=path.model.pattern.dof_count,
        newton_iterations=path.counts.newton_iterations,
        factorisations=None if path.quick is None else path.quick.factorisations,
        setup_s=setup_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        force_error=float(point.force_n[2]) / exact_n - 1.0,
        memory_mib=peak_memory_mib(),
    )
