"""What each way of reusing work saves: the same travel without one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from sim.effects.presets import build_model
from sim.scene.scene import Preset, Scene, Target
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from sim.solve.newton import NewtonOptions
from sim.solve.preconditioned_lbfgs import QuickOptions
from sim.studies.bench.frames import FRAME_COUNT, TRAVEL_M

_OPTIONS = NewtonOptions(residual_relative=1e-6)
_STUBBORN = ((60, 0.0),)
_NEVER = 10**9

# The first is preset fast as it is.
WAYS: dict[str, QuickOptions] = {
    "factors kept, steps remembered, predicted by three points": QuickOptions(),
    "predicted by two points": QuickOptions(points=2),
    "started from the last point": QuickOptions(points=1),
    "no steps remembered": QuickOptions(memory=0),
    "a factor for every frame": QuickOptions(tired=0),
    "a factor renewed only after 60 steps": QuickOptions(tired=_NEVER, patience=_STUBBORN),
}
NEWTON = "Newton's method, a factor for every step"
ONE_PATH, EACH_ANEW = "the replay's forces on one path", "the replay's forces each anew"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReuseRow:
    """What a travel or a replay took.

    Attributes:
        evaluations: Of the forces; None where they are not counted.
        cpu_s: Processor time, mesh and set-up not included [s].
    """

    way: str
    evaluations: int | None
    factorisations: int
    cpu_s: float
    force_n: float


def measure_reuse(
    scene: Scene, forces_n: Sequence[float], *, ways: Sequence[str] = tuple(WAYS)
) -> Iterator[ReuseRow]:
    """Press 1 mm deep in 20 frames with preset fast, in one way after the other.

    Args:
        forces_n: Of a replay [N], which is then made on one path and on one path a force.
        ways: Names of ``WAYS``.

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    scene = replace(scene, preset=Preset.FAST, target=Target(depth_m=TRAVEL_M))
    model = build_model(scene)
    for name in ways:
        yield _timed(name, [_path(scene, model, WAYS[name])], [_travel])
    newton = LoadingPath(model, scene.indenter, scene.centre_m, options=_OPTIONS)
    yield _timed(NEWTON, [newton], [_travel])
    ordered = sorted(forces_n)
    one = [_path(scene, model, QuickOptions())] * len(ordered)
    anew = [_path(scene, model, QuickOptions()) for _ in ordered]
    for name, paths in ((ONE_PATH, one), (EACH_ANEW, anew)):
        yield _timed(name, paths, [partial(LoadingPath.push, force_n=force) for force in ordered])


def _path(scene: Scene, model: Model, options: QuickOptions) -> LoadingPath:
    return LoadingPath(
        model,
        scene.indenter,
        scene.centre_m,
        options=_OPTIONS,
        is_quick=True,
        quick_options=options,
    )


def _travel(path: LoadingPath) -> None:
    for frame in range(1, FRAME_COUNT + 1):
        path.advance(TRAVEL_M * frame / FRAME_COUNT)


def _timed(
    way: str, paths: Sequence[LoadingPath], legs: Sequence[Callable[[LoadingPath], object]]
) -> ReuseRow:
    """Go every leg on its path; a path may serve several."""
    spent = time.process_time()
    for path, leg in zip(paths, legs, strict=True):
        leg(path)
    spent = time.process_time() - spent
    distinct = {id(path): path for path in paths}.values()
    quick = [path.quick for path in distinct if path.quick is not None]
    # Newton's method factors at every step, and once more where it has arrived.
    newton = sum(path.counts.newton_iterations + path.counts.increments for path in distinct)
    last = paths[-1].last
    return ReuseRow(
        way=way,
        evaluations=sum(each.evaluations for each in quick) if quick else None,
        factorisations=sum(each.factorisations for each in quick) if quick else newton,
        cpu_s=spent,
        force_n=0.0 if last is None else float(last.force_n[2]),
    )
