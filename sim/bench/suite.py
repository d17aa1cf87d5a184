"""All of the benchmark, in one go."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from sim.bench.batches import (
    BALANCE,
    ENVIRONMENTS_ON_CPU,
    BatchRow,
    batch_device,
    exact_force,
    measure_batches,
)
from sim.bench.frames import TRAVEL_M, FrameRow, travel
from sim.bench.growth import GrowthRow, growth
from sim.bench.peer.rows import PeerRow, measure_libuipc, why_no_libuipc
from sim.bench.phases import PhaseRow, Render, phases
from sim.bench.rendering import BATCH, RenderingRow, measure_rendering
from sim.effects import plan_effects
from sim.optics.geometry import CameraGeometry
from sim.press import path_for
from sim.replay import replay_forces
from sim.scene import Preset, Scene, Target
from sim.sensor import load_sensor

PRESETS = (Preset.FAST, Preset.BALANCED)
_PHASE_DEPTH_M = 0.5e-3
_WARM_M = 0.02e-3

Progress = Callable[[str], None]


class Part(StrEnum):
    """Parts of the benchmark, in the order of its page."""

    FRAMES = "frames"
    BATCHES = "batches"
    PHASES = "phases"
    RENDERING = "rendering"
    REPLAY = "replay"
    GROWTH = "growth"


class Peer(StrEnum):
    """Other engines that can be measured beside the batches."""

    LIBUIPC = "libuipc"


_NO_GPU = {
    Part.BATCHES: f"more than {max(ENVIRONMENTS_ON_CPU)} environments side by side",
    Part.RENDERING: f"{BATCH} images at once",
}


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
    """What was measured; what was not asked for is empty.

    Attributes:
        absent: What could not be measured, and why.
    """

    frames: tuple[FrameRow, ...] = ()
    batches: tuple[BatchRow, ...] = ()
    peers: tuple[PeerRow, ...] = ()
    phases: tuple[PhaseRow, ...] = ()
    rendering: tuple[RenderingRow, ...] = ()
    replays: tuple[ReplayRow, ...] = ()
    growth: tuple[GrowthRow, ...] = ()
    absent: tuple[str, ...] = ()


def run_bench(
    scene: Scene,
    geometry: CameraGeometry,
    render: Render,
    forces_n: Sequence[float],
    *,
    parts: Collection[Part] = tuple(Part),
    presets: Sequence[Preset] = PRESETS,
    peer: Peer | None = None,
    on_progress: Progress = lambda _text: None,
) -> Bench:
    """Measure everything that this machine can.

    Args:
        scene: Its target does not matter, its preset is that of the growth.
        geometry: The image's pixels.
        render: Turns height maps into the tactile image.
        forces_n: Of the replay [N].
        parts: What to measure.
        peer: Run the batches' press by this engine too, after the batches.

    Raises:
        ConvergenceError: A press does not go through.
    """
    scene = replace(scene, target=Target(depth_m=TRAVEL_M))
    _warm_up(scene)
    frames: list[FrameRow] = []
    phase_rows: list[PhaseRow] = []
    replays: list[ReplayRow] = []
    for preset in presets:
        if Part.FRAMES in parts:
            on_progress(f"frames, preset {preset}")
            frames.append(travel(scene, preset))
        if Part.PHASES in parts:
            on_progress(f"parts, preset {preset}")
            phase_rows += phases(scene, preset, geometry, render, depth_m=_PHASE_DEPTH_M)
        if Part.REPLAY in parts:
            on_progress(f"replay, preset {preset}")
            replays.append(_replay(scene, preset, forces_n))
    batches, peers, absent = _side_by_side(scene, parts, peer, on_progress)
    grown: Sequence[GrowthRow] = ()
    if Part.GROWTH in parts:
        on_progress("growth with elements")
        grown = growth(scene, depth_m=_PHASE_DEPTH_M)
    rendering: list[RenderingRow] = []
    if Part.RENDERING in parts:
        on_progress(f"rendering, batches on {batch_device()}")
        rendering += measure_rendering(scene)
    without_gpu = [what for part, what in _NO_GPU.items() if part in parts]
    if batch_device() == "cpu":
        absent += [f"{what}, which is done on a GPU: there is none here" for what in without_gpu]
    return Bench(
        frames=tuple(frames),
        batches=tuple(batches),
        peers=tuple(peers),
        phases=tuple(phase_rows),
        rendering=tuple(rendering),
        replays=tuple(replays),
        growth=tuple(grown),
        absent=tuple(absent),
    )


def _side_by_side(
    scene: Scene, parts: Collection[Part], peer: Peer | None, on_progress: Progress
) -> tuple[list[BatchRow], list[PeerRow], list[str]]:
    """Measure batches, and the peer after them; return what could not be measured too."""
    device, absent = batch_device(), []
    batches: list[BatchRow] = []
    peers: list[PeerRow] = []
    without = "" if peer is None else why_no_libuipc(scene, device=device)
    if without:
        on_progress(f"not measured: {without}")
        absent.append(without)
    has_peer = peer is not None and not without
    if Part.BATCHES not in parts and not has_peer:
        return batches, peers, absent
    exact_n = exact_force(scene)
    if Part.BATCHES in parts:
        on_progress(f"batches on {device}")
        for row in measure_batches(scene, device=device, exact_n=exact_n):
            on_progress(f"  {row.environments} environments: {row.frames_per_s:.0f} frames/s")
            batches.append(row)
    if has_peer:
        on_progress(f"libuipc on {device}")
        for found in measure_libuipc(scene, exact_n=exact_n, balance=BALANCE):
            on_progress(f"  {found.summary}")
            peers.append(found)
    return batches, peers, absent


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
