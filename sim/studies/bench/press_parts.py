"""What a press takes: each part of its work alone, and how it grows with its elements."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.plan import plan_effects
from sim.fields.press_fields import surface_state
from sim.fields.stress import surface_stress
from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.press import path_for
from sim.scene.scene import Preset, Scene
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.path import LoadingPath

_REPEATS, _REPEATS_LEAST = 30, 3
_BUDGET_S = 3.0
Render = Callable[[HeightMaps], ImageArray]
REFINEMENTS = (0.7, 1.0, 1.4, 2.0, 2.5)
EXPONENT_WANTED = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PartRow:
    """A part of the work.

    Attributes:
        name: ``assembly``, ``factorisation``, ``solution`` and ``contact`` are done once or more a
            Newton iteration; ``stress``, ``height map`` and ``rendering`` once a frame.
        median_s: Over its repeats [s].
        least_s: The shortest of them [s]: a busy machine changes it least.
    """

    preset: str
    name: str
    median_s: float
    least_s: float
    repeats: int


def part_times(
    scene: Scene,
    preset: Preset,
    geometry: CameraGeometry,
    render: Render,
    *,
    depth_m: float,
) -> list[PartRow]:
    """Press a scene and time every part on what came out.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(scene, preset=preset)
    path = path_for(scene, plan_effects(scene))
    point = path.advance(depth_m)
    maps = height_maps(surface_state(path, point), geometry)
    parts: dict[str, Callable[[], object]] = {
        **_solver_parts(path, point),
        "stress": lambda: surface_stress(path.model, point.state.positions),
        "height map": lambda: height_maps(surface_state(path, point), geometry),
        "rendering": lambda: render(maps),
    }
    return [_timed(preset, name, part) for name, part in parts.items()]


def _solver_parts(path: LoadingPath, point: PathPoint) -> dict[str, Callable[[], object]]:
    model, positions, state = path.model, point.state.positions, point.state
    stiffness = point.equilibrium.contact.stiffness
    right_side = model.pattern.unknowns(point.equilibrium.elastic_gradient)
    return {
        "assembly": lambda: (
            model.gel.energy(positions),
            model.gel.gradient(positions),
            model.hessian_data(positions, stiffness, projected=False),
        ),
        "factorisation": lambda: path.solver.factor.renew(state),
        "solution": lambda: path.solver.factor.solve(right_side),
        "contact": lambda: (
            model.surface.gaps(positions, path.indenter, state),
            model.surface.energy(positions, path.indenter, state),
            model.surface.scatter(model.surface.forces(positions, path.indenter, state).forces),
        ),
    }


def _timed(preset: Preset, name: str, part: Callable[[], object]) -> PartRow:
    times = times_of(part, most=_REPEATS, least=_REPEATS_LEAST, budget_s=_BUDGET_S)
    return PartRow(
        preset=preset.value,
        name=name,
        median_s=float(np.median(times)),
        least_s=min(times),
        repeats=len(times),
    )


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
