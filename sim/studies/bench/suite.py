"""All of the benchmark, in one go."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error.tolerance import Tolerance
from sim.scene.scene import Preset, Scene
from sim.studies.bench.factor_threads import ThreadsRow, measure_threads
from sim.studies.bench.growth import GrowthRow, growth
from sim.studies.bench.part import Part
from sim.studies.bench.rendering import BATCH, RenderingRow, batch_device, measure_rendering
from sim.studies.bench.replays import FORCE_ERROR_MAX, ImageOf, ReplayRow, measure_replay
from sim.studies.bench.start import StartRow, measure_start

_GROWTH_DEPTH_M = 0.5e-3
_WARM_M = 0.02e-3

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Benchmark:
    """What was measured; what was not asked for is empty.

    Attributes:
        absent: What could not be measured, and why.
    """

    rendering: tuple[RenderingRow, ...] = ()
    replays: tuple[ReplayRow, ...] = ()
    growth: tuple[GrowthRow, ...] = ()
    start: tuple[StartRow, ...] = ()
    threads: tuple[ThreadsRow, ...] = ()
    absent: tuple[str, ...] = ()


def run_bench(
    scene: Scene,
    image_of: ImageOf,
    forces_n: Sequence[float],
    *,
    parts: Collection[Part] = tuple(Part),
    on_progress: Progress = lambda _text: None,
) -> Benchmark:
    """Measure everything that this machine can.

    Args:
        scene: Its target does not matter, its preset is that of the growth.
        image_of: Turns a pressed surface into the image that a replay keeps.
        forces_n: Of the replay [N].
        parts: What to measure; the scenes are measured apart, ``sim.studies.bench.scenes``.

    Raises:
        ConvergenceError: A press does not go through.
    """
    _warm_up(scene)
    # The replays first: their row has the process's peak of memory so far.
    measures: dict[Part, tuple[str, Callable[[], Iterable[object]]]] = {
        Part.REPLAY: (
            "replays",
            lambda: [
                measure_replay(replace(scene, preset=Preset.FAST), forces_n, image_of),
                measure_replay(
                    scene, forces_n, image_of, tolerance=Tolerance(relative=FORCE_ERROR_MAX)
                ),
            ],
        ),
        Part.GROWTH: ("growth", lambda: growth(scene, depth_m=_GROWTH_DEPTH_M)),
        Part.START: ("start", measure_start),
        Part.THREADS: ("threads", lambda: measure_threads(scene)),
        Part.RENDERING: ("rendering", lambda: measure_rendering(scene)),
    }
    rows: defaultdict[str, list[Any]] = defaultdict(list)
    for part, (name, measure) in measures.items():
        if part in parts:
            on_progress(part.value)
            rows[name] += measure()
    if Part.RENDERING in parts and batch_device() == "cpu":
        rows["absent"].append(f"{BATCH} images at once, which is done on a GPU: there is none here")
    return Benchmark(**{name: tuple(found) for name, found in rows.items()})


def _warm_up(scene: Scene) -> None:
    """Compile and load the kernels, which no time should hold."""
    small = replace(scene, preset=Preset.FAST)
    path_for(small, plan_effects(small), refinement=0.5).advance(_WARM_M)
