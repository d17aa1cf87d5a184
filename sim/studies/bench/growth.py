"""How a press grows with its elements."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.scene.scene import Scene

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
    return [_pressed(scene, depth_m, refinement) for refinement in refinements]


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Return p of the power law time = c size^p that fits best, in logarithms."""
    slope, _ = np.polyfit(np.log(sizes), np.log(times), 1)
    return float(slope)


def local_exponents(sizes: Sequence[float], times: Sequence[float]) -> list[float]:
    """Return p between neighbouring sizes."""
    steps = np.diff(np.log(times)) / np.diff(np.log(sizes))
    return [float(step) for step in steps]


def _pressed(scene: Scene, depth_m: float, refinement: float) -> GrowthRow:
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
