"""Frames a second: an indenter that travels 1 mm into a gel in 20 frames."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from sim.bench.memory import peak_memory_mib
from sim.effects import plan_effects
from sim.press import path_for
from sim.scene import Preset, Scene

TRAVEL_M = 1e-3
FRAME_COUNT = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow:
    """What a travel took.

    Attributes:
        setup_s: Mesh, upload and symbolic factorisation [s].
        wall_s: All frames [s].
        memory_mib: The process's peak so far [MiB].
    """

    preset: str
    device: str
    tet_count: int
    node_count: int
    newton_iterations: int
    setup_s: float
    wall_s: float
    memory_mib: float

    @property
    def frame_ms(self) -> float:
        """Time of a frame [ms]."""
        return 1e3 * self.wall_s / FRAME_COUNT

    @property
    def frames_per_s(self) -> float:
        """Frames a second [1/s]."""
        return FRAME_COUNT / self.wall_s


def travel(scene: Scene, preset: Preset, *, device: str = "cpu") -> FrameRow:
    """Press 1 mm deep in frames of 0.05 mm; the kernels should be warm.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(scene, preset=preset)
    started = time.perf_counter()
    path = path_for(scene, plan_effects(scene), device=device)
    ready = time.perf_counter()
    for frame in range(1, FRAME_COUNT + 1):
        path.advance(TRAVEL_M * frame / FRAME_COUNT)
    return FrameRow(
        preset=preset.value,
        device=device,
        tet_count=len(path.model.elements),
        node_count=len(path.model.nodes),
        newton_iterations=path.counts.newton_iterations,
        setup_s=ready - started,
        wall_s=time.perf_counter() - ready,
        memory_mib=peak_memory_mib(),
    )
