"""What the parts of the work take, each alone, on the state at the end of a press."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.plan import plan_effects
from sim.fields.press_fields import surface_state
from sim.fields.stress import surface_stress
from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.press import path_for
from sim.scene.scene import Preset, Scene
from sim.solve.load_steps.path import LoadingPath
from sim.solve.load_steps.path_point import PathPoint

_REPEATS = 30
_BUDGET_S = 3.0

Render = Callable[[HeightMaps], ImageArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseRow:
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


def phases(
    scene: Scene,
    preset: Preset,
    geometry: CameraGeometry,
    render: Render,
    *,
    depth_m: float,
    device: str = "cpu",
) -> list[PhaseRow]:
    """Press a scene and time every part on what came out.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(scene, preset=preset)
    path = path_for(scene, plan_effects(scene), device=device)
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
    data = model.hessian_data(positions, stiffness, projected=False)
    right_side = model.pattern.unknowns(point.equilibrium.elastic_gradient)
    return {
        "assembly": lambda: (
            model.elastic_energy(positions),
            model.elastic_gradient(positions),
            model.hessian_data(positions, stiffness, projected=False),
        ),
        "factorisation": lambda: path.solver.factorise(data),
        "solution": lambda: path.solver.solve(right_side),
        "contact": lambda: (
            model.gaps(positions, path.indenter, state),
            model.contact_energy(positions, path.indenter, state),
            model.scatter(model.contact_forces(positions, path.indenter, state).forces),
        ),
    }


def _timed(preset: Preset, name: str, part: Callable[[], object]) -> PhaseRow:
    part()
    times: list[float] = []
    while len(times) < _REPEATS and (len(times) < 3 or sum(times) < _BUDGET_S):
        started = time.perf_counter()
        part()
        times.append(time.perf_counter() - started)
    return PhaseRow(
        preset=preset.value,
        name=name,
        median_s=float(np.median(times)),
        least_s=min(times),
        repeats=len(times),
    )
