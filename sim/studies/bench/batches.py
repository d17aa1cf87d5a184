"""Frames a second of many environments side by side, with what their forces are worth."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, BatchResult, Course, Environment, course_of
from sim.batch.pilot import Pilot, batch_model
from sim.press import press
from sim.scene.scene import Preset, Scene, Target
from sim.scene.tilted_indenter import tilted
from sim.solve.model import Model
from sim.studies.bench.frames import FRAME_COUNT, TRAVEL_M, TimedFrames, times_of

_LAUNCHES = 50
# Steps that are remembered while launches are timed.
_REMEMBERED = 8
ENVIRONMENTS = (1, 8, 60, 256, 1024)
ENVIRONMENTS_ON_CPU = (1, 8)
BALANCE = 1e-5
# The pilot goes a little further than they do, and in none of their gels.
_PILOTS_WAY = 1.05
_PRESSES = 3
# The environments after the first differ by up to so much in modulus and Poisson's ratio, and are
# pressed so much less deep.
_SPREAD, _POISSON_SPREAD = 0.1, 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class StressTimes:
    """What the stress on the surface of all environments takes (paper, Algorithm 1).

    Attributes:
        face_count: Faces of an environment.
        device_s: From displacements to stresses, both on the device [s].
        host_s: The same with its launch from the host and the copy to the host's memory [s].
    """

    face_count: int
    device_s: float
    host_s: float


def stress_times(batch: Batch, *, repeats: int = _LAUNCHES) -> StressTimes:
    """Time taking the stress off the last press; the shortest of the ways to the host."""
    device_s = _time_of(batch.stress.launch, device=batch.device, repeats=repeats)
    fetched = times_of(batch.surface_stresses, most=repeats, least=repeats, budget_s=0.0)
    return StressTimes(face_count=len(batch.model.faces), device_s=device_s, host_s=min(fetched))


def batch_parts(batch: Batch, *, repeats: int = _LAUNCHES) -> dict[str, float]:
    """Time the launches of a step of the descents, all environments taking it [s].

    The batch is reset.
    """
    parts = {}
    blocks = batch.together.blocks
    one_serves = np.arange(len(blocks)) * batch.together.width < batch.count
    blocks.assign(np.where(one_serves, 0, -1).astype(np.int32))
    for name, launch in batch.descents.launches.items():
        batch.reset()
        batch.descents.pretend_to_step(remembered=_REMEMBERED)
        parts[name] = _time_of(launch, device=batch.device, repeats=repeats)
    batch.reset()
    return parts


def _time_of(launch: Callable[[], None], *, device: str, repeats: int) -> float:
    """Return the mean time of a launch [s]; on a GPU from one graph of them all."""
    launch()
    if device == "cpu":
        started = time.perf_counter()
        for _ in range(repeats):
            launch()
        return (time.perf_counter() - started) / repeats
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(repeats):
            launch()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    started = time.perf_counter()
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    return (time.perf_counter() - started) / repeats


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchRow(TimedFrames):
    """What a batch took, and how good it was.

    Attributes:
        setup_s: The pilot press and its inverses, which all batches share [s].
        evaluations: Of the forces, for a frame of an environment.
        imbalance: Base reaction against indenter force, over the latter, the largest.
        residual: Norm of the unbalanced force over the contact force, the largest.
        gap_m: The smallest [m].
        failed_count: Environments that did not reach their last frame.
        stress: What taking the stress off the surface takes.
        parts_s: What each launch of a step takes [s].
    """

    device: str
    environments: int
    setup_s: float
    evaluations: float
    imbalance: float
    residual: float
    gap_m: float
    failed_count: int
    stress: StressTimes
    parts_s: dict[str, float]

    @property
    def _travelling(self) -> int:
        return self.environments - self.failed_count


def batch_device() -> str:
    """Return the device that batches are for: the first GPU, else the CPU."""
    return "cuda:0" if wp.get_cuda_device_count() > 0 else "cpu"


def measure_batches(
    scene: Scene,
    *,
    device: str,
    exact_n: float,
    counts: Sequence[int] | None = None,
) -> Iterator[BatchRow]:
    """Press 1 mm deep in 20 frames, in more and more environments.

    Args:
        scene: Pad, gel and indenter; gels and depths differ from environment to environment.
        exact_n: Force that the first environment's is compared with [N].
        counts: Environments; by default as many as the device is for.
    """
    counts = counts or (ENVIRONMENTS if device != "cpu" else ENVIRONMENTS_ON_CPU)
    deep = replace(scene, target=Target(depth_m=TRAVEL_M))
    course = course_of(deep, frame_count=FRAME_COUNT)
    pilot = pilot_for(deep, batch_model(deep), course)
    for count in counts:
        chosen = spread(deep, course, count, poisson=0.0)
        yield _row(pilot, chosen, exact_n=exact_n, device=device)


def exact_force(scene: Scene, *, preset: Preset = Preset.ACCURATE) -> float:
    """Return F_z at the end of the travel by one press of a preset [N]."""
    deep = replace(scene, target=Target(depth_m=TRAVEL_M), preset=preset)
    return float(press(deep).force_n[2])


def spread(
    scene: Scene, course: Course, count: int, *, poisson: float = _POISSON_SPREAD
) -> list[tuple[Environment, Course]]:
    """Return the scene itself and others a little unlike it, always the same ones.

    Gels are up to a tenth stiffer, with Poisson's ratios up to 0.01 smaller, and pressed up to a
    tenth less deep or hard.

    Args:
        poisson: How much smaller Poisson's ratios are at most.
    """
    random = np.random.default_rng(0)
    found = []
    for number in range(count):
        stiffer, thinner, weaker = random.random(3) if number else np.zeros(3)
        own = tuple(
            replace(
                material,
                young_pa=material.young_pa * (1.0 + _SPREAD * stiffer),
                poisson=material.poisson - poisson * thinner,
            )
            for material in scene.materials
        )
        found.append((Environment(materials=own), course.scaled(1.0 - _SPREAD * weaker)))
    return found


def pilot_for(scene: Scene, model: Model, course: Course) -> Pilot:
    """Return a pilot that keeps every frame."""
    return Pilot(
        model,
        scene.indenter,
        course.scaled(_PILOTS_WAY),
        scene.centre_m,
        rotation=tilted(*scene.motion.tilt_rad),
        count=course.frame_count,
    )


def _row(
    pilot: Pilot, chosen: Sequence[tuple[Environment, Course]], *, exact_n: float, device: str
) -> BatchRow:
    batch, results = pressed(pilot, chosen, device=device)
    found = min(results, key=lambda result: result.wall_s)
    return BatchRow(
        device=wp.get_device(device).name if device != "cpu" else device,
        environments=len(chosen),
        tet_count=len(pilot.model.elements),
        unknown_count=pilot.model.pattern.dof_count,
        setup_s=pilot.setup_s,
        wall_s=found.wall_s,
        evaluations=float(found.evaluations.mean()) / FRAME_COUNT,
        force_error=float(found.force_n[-1, 0, 2]) / exact_n - 1.0,
        imbalance=float(np.nanmax(np.abs(found.imbalance))),
        residual=float(np.nanmax(found.residual)),
        gap_m=float(np.nanmin(found.gap_m)),
        failed_count=int(found.failed.sum()),
        stress=stress_times(batch),
        parts_s=batch_parts(batch),
    )


def pressed(
    pilot: Pilot, chosen: Sequence[tuple[Environment, Course]], *, device: str
) -> tuple[Batch, list[BatchResult]]:
    """Press a batch several times, kernels and graphs made before."""
    environments, courses = zip(*chosen, strict=True)
    options = BatchOptions(residual_relative=BALANCE)
    batch = Batch(pilot, environments, options=options, device=device)
    batch.prepare(courses[0].frame_count)
    return batch, [batch.press(courses) for _ in range(_PRESSES)]
