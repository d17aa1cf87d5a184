"""All of the benchmark, in one go."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from sim.bench.batches import ENVIRONMENTS_ON_CPU, BatchRow, batch_device, measure_batches
from sim.bench.frames import TRAVEL_M, FrameRow, exact_force_n, travels
from sim.bench.growth import GrowthRow, growth
from sim.bench.phases import PhaseRow, Render, phases
from sim.bench.replays import ImageOf, ReplayRow, measure_replay
from sim.bench.reuse import ReuseRow, measure_reuse
from sim.effects import plan_effects
from sim.optics.geometry import CameraGeometry
from sim.press import path_for
from sim.scene import Preset, Scene, Target

PRESETS = (Preset.FAST, Preset.BALANCED)
_PHASE_DEPTH_M = 0.5e-3
_WARM_M = 0.02e-3
_NO_GPU = "more than {count} environments side by side, which is done on a GPU: there is none here"

Progress = Callable[[str], None]


class Part(StrEnum):
    """Parts of the benchmark, in the order of its page."""

    FRAMES = "frames"
    REUSE = "reuse"
    BATCHES = "batches"
    PHASES = "phases"
    REPLAY = "replay"
    GROWTH = "growth"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """What was measured; what was not asked for is empty.

    Attributes:
        absent: What could not be measured, and why.
    """

    frames: tuple[FrameRow, ...] = ()
    reuse: tuple[ReuseRow, ...] = ()
    batches: tuple[BatchRow, ...] = ()
    phases: tuple[PhaseRow, ...] = ()
    replays: tuple[ReplayRow, ...] = ()
    growth: tuple[GrowthRow, ...] = ()
    absent: tuple[str, ...] = ()


def run_bench(
    scene: Scene,
    geometry: CameraGeometry,
    render: Render,
    image_of: ImageOf,
    forces_n: Sequence[float],
    *,
    parts: Collection[Part] = tuple(Part),
    presets: Sequence[Preset] = PRESETS,
    against: Preset = Preset.ACCURATE,
    on_progress: Progress = lambda _text: None,
) -> Bench:
    """Measure everything that this machine can.

    Args:
        scene: Its target does not matter, its preset is that of the growth.
        geometry: The image's pixels.
        render: Turns height maps into the tactile image.
        image_of: Turns a pressed surface into the image that a replay keeps.
        forces_n: Of the replay [N].
        parts: What to measure.
        presets: For the parts of the work and the replay.
        against: Whose force at the end of the travel is taken for exact.

    Raises:
        ConvergenceError: A press does not go through.
    """
    scene = replace(scene, target=Target(depth_m=TRAVEL_M))
    _warm_up(scene)
    exact_n = 0.0
    if {Part.FRAMES, Part.BATCHES} & set(parts):
        on_progress(f"F_z with preset {against}")
        exact_n = exact_force_n(scene, against)
    frames: list[FrameRow] = []
    if Part.FRAMES in parts:
        on_progress("frames")
        for travelled in travels(scene, exact_n=exact_n):
            on_progress(f"  preset {travelled.setting}: {travelled.frames_per_s:.0f} frames/s")
            frames.append(travelled)
    reuse: list[ReuseRow] = []
    if Part.REUSE in parts:
        on_progress("what reuse saves")
        reuse += measure_reuse(scene, forces_n)
    phase_rows: list[PhaseRow] = []
    replays: list[ReplayRow] = []
    for preset in presets:
        if Part.PHASES in parts:
            on_progress(f"parts, preset {preset}")
            phase_rows += phases(scene, preset, geometry, render, depth_m=_PHASE_DEPTH_M)
        if Part.REPLAY in parts:
            on_progress(f"replay, preset {preset}")
            replays.append(measure_replay(scene, preset, forces_n, image_of))
    batches: list[BatchRow] = []
    device = batch_device()
    if Part.BATCHES in parts:
        on_progress(f"batches on {device}")
        for row in measure_batches(scene, device=device, exact_n=exact_n):
            on_progress(f"  {row.environments} environments: {row.frames_per_s:.0f} frames/s")
            batches.append(row)
    grown: Sequence[GrowthRow] = ()
    if Part.GROWTH in parts:
        on_progress("growth with elements")
        grown = growth(scene, depth_m=_PHASE_DEPTH_M)
    short = Part.BATCHES in parts and device == "cpu"
    return Bench(
        frames=tuple(frames),
        reuse=tuple(reuse),
        batches=tuple(batches),
        phases=tuple(phase_rows),
        replays=tuple(replays),
        growth=tuple(grown),
        absent=(_NO_GPU.format(count=max(ENVIRONMENTS_ON_CPU)),) if short else (),
    )


def _warm_up(scene: Scene) -> None:
    """Compile and load the kernels, which no time should hold."""
    small = replace(scene, preset=Preset.FAST)
    path_for(small, plan_effects(small), refinement=0.5).advance(_WARM_M)
