"""All of the benchmark, in one go."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sim.bench.frames import TRAVEL_M, FrameRow, travel
from sim.bench.growth import GrowthRow, growth
from sim.bench.phases import PhaseRow, Render, phases
from sim.effects import plan_effects
from sim.optics.geometry import CameraGeometry
from sim.press import path_for
from sim.replay import replay_forces
from sim.scene import Preset, Scene, Target
from sim.sensor import load_sensor

PRESETS = (Preset.FAST, Preset.BALANCED)
ENVIRONMENTS = (1, 8, 60, 256, 1024)
_PHASE_DEPTH_M = 0.5e-3
_WARM_M = 0.02e-3
_NO_BATCH = "{counts} environments side by side, which is done on a GPU"

Batch = Callable[[Scene, Preset, int], FrameRow]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRow:
    """A replay of a run's forces.

    Attributes:
        wall_s: Mesh, presses and fields; no images [s].
    """

    preset: str
    trial_count: int
    newton_iterations: int
    wall_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """What was measured.

    Attributes:
        absent: What was not, and why.
    """

    frames: tuple[FrameRow, ...]
    phases: tuple[PhaseRow, ...]
    replays: tuple[ReplayRow, ...]
    growth: tuple[GrowthRow, ...]
    absent: tuple[str, ...]


def run_bench(
    scene: Scene,
    geometry: CameraGeometry,
    render: Render,
    forces_n: Sequence[float],
    *,
    presets: Sequence[Preset] = PRESETS,
    batch: Batch | None = None,
    environments: Sequence[int] = ENVIRONMENTS,
    on_progress: Progress = lambda _text: None,
) -> Bench:
    """Measure everything that this machine can.

    Args:
        scene: Its target does not matter, its preset is that of the growth.
        geometry: The image's pixels.
        render: Turns height maps into the tactile image.
        forces_n: Of the replay [N].
        batch: Travels in many environments side by side; None where nothing here can.

    Raises:
        ConvergenceError: A press does not go through.
    """
    scene = replace(scene, target=Target(depth_m=TRAVEL_M))
    _warm_up(scene)
    frames: list[FrameRow] = []
    parts: list[PhaseRow] = []
    replays: list[ReplayRow] = []
    for preset in presets:
        on_progress(f"frames, preset {preset}")
        frames.append(travel(scene, preset))
        on_progress(f"parts, preset {preset}")
        parts += phases(scene, preset, geometry, render, depth_m=_PHASE_DEPTH_M)
        on_progress(f"replay, preset {preset}")
        replays.append(_replay(scene, preset, forces_n))
    absent = [_NO_BATCH.format(counts=", ".join(map(str, environments)))] if batch is None else []
    if batch is not None:
        for count in environments:
            on_progress(f"{count} environments")
            frames.append(batch(scene, presets[0], count))
    on_progress("growth with elements")
    return Bench(
        frames=tuple(frames),
        phases=tuple(parts),
        replays=tuple(replays),
        growth=tuple(growth(scene, depth_m=_PHASE_DEPTH_M)),
        absent=tuple(absent),
    )


def _warm_up(scene: Scene) -> None:
    """Compile and load the kernels, which no time should hold."""
    small = replace(scene, preset=Preset.FAST)
    path_for(small, plan_effects(small), refinement=0.5).advance(_WARM_M)


def _replay(scene: Scene, preset: Preset, forces_n: Sequence[float]) -> ReplayRow:
    started = time.perf_counter()
    found, _ = replay_forces(load_sensor(scene.sensor), scene.indenter, forces_n, preset=preset)
    return ReplayRow(
        preset=preset.value,
        trial_count=len(found.trials),
        newton_iterations=sum(trial.newton_iterations for trial in found.trials),
        wall_s=time.perf_counter() - started,
    )
