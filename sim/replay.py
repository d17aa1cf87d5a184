"""Replay of a run's measured forces on one model, one loading path for all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from sim.effects.coarse import CoarsePath
from sim.effects.effect_plan import EffectPlan
from sim.effects.outputs import outputs_of
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error.estimate import ErrorEstimate, estimate_from, estimated, failed, rung
from sim.error.tolerance import Tolerance, alternatives, setting_of
from sim.fields.press_fields import PassedStates, TrialFields, passed_state, trial_fields
from sim.mesh.elements import ElementOrder
from sim.press import measure
from sim.scene.indenter import Indenter, describe
from sim.scene.scene import ContactMode, Drive, Effect, Motion, Output, Preset, Scene, Target
from sim.sensor.sensor import Sensor
from sim.solve.force_search import ForceMatch, find_force, push_to_force
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint
from sim.walk import Walk
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.simulated import Replay, ReplayLayer, ReplayModel, ReplayTrial
from tacauchy_rig.core.versions import installed

Progress = Callable[[int, str], None]


def replay_scene(
    sensor: Sensor,
    indenter: Indenter,
    forces_n: Sequence[float],
    *,
    preset: Preset = Preset.BALANCED,
    tolerance_n: float = 0.08,
    drive: Drive = Drive.LOAD,
    friction: float = 0.0,
    tilt_rad: tuple[float, float] = (0.0, 0.0),
    centre_m: tuple[float, float] = (0.0, 0.0),
    duration_s: float = 1.0,
) -> Scene:
    """Return the press to the largest of some forces.

    Args:
        forces_n: Pressing forces [N].
        tolerance_n: Largest |F_z simulated - measured| [N].
        tilt_rad: Rotations of the indenter about x and y [rad].
        centre_m: Where its tip comes down [m].
        duration_s: Time from touch to dwell [s], for a gel that relaxes.
    """
    return sensor.scene(
        indenter,
        Target(force_n=max([0.0, *forces_n])),
        drive=drive,
        preset=preset,
        force_tolerance_n=tolerance_n,
        contact=ContactMode.FRICTION if friction else ContactMode.FRICTIONLESS,
        friction=friction,
        motion=Motion(tilt_rad=tilt_rad),
        centre_m=centre_m,
        duration_s=duration_s,
        outputs=frozenset(Output),
    )


def replay_forces(
    scene: Scene,
    forces_n: Sequence[float],
    *,
    tolerance: Tolerance | None = None,
    on_progress: Progress | None = None,
    name: str = "force-matched",
    walk: Walk | None = None,
    stiffer: float = 1.0,
) -> tuple[Replay, list[TrialFields]]:
    """Press until F_z agrees with each measured force, the smallest first, on one path.

    Driven by load, the force is met to rounding. The paper's displacement search (section IV-C)
    goes on to a tenth of the scene's tolerance, since that costs one Newton step or two: the
    remaining mismatch then says nothing about the simulation. A gel that relaxes is pressed anew
    for each force, in the scene's time: what it remembers of a smaller one was another trial.

    Args:
        scene: As ``replay_scene`` makes it.
        forces_n: Measured pressing forces [N] in the order of the trials, in any order of size.
        tolerance: What the scene's preset was chosen by, for the record.
        on_progress: Called with the trial's number (from 1) and a line of text.
        walk: A walk to these forces with another gel: where it serves, each force is gone on to
            from there.
        stiffer: How many times as stiff as that gel this one is.

    Returns:
        The replay, and the fields of each trial in the order of ``forces_n``.

    Raises:
        ConvergenceError: A force cannot be reached; the message names how far the press got.
    """
    say = on_progress or (lambda _index, _text: None)
    started = time.perf_counter()
    plan = plan_effects(scene)
    if walk is not None and not walk.serves(scene, plan):
        walk = None
    largest_n = max(forces_n, default=0.0)
    if walk is None:
        path = path_for(scene, plan, keeps_all=True)
        passed = PassedStates(path, largest_n)
    else:
        path = walk.path.stiffer(stiffer)
        passed = PassedStates(walk.path, largest_n, stiffer=stiffer)
    worth, last_n = _Worth(scene, plan), 0.0
    trials: dict[int, tuple[ReplayTrial, TrialFields]] = {}
    for position in sorted(range(len(forces_n)), key=lambda k: forces_n[k]):
        if plan.is_on(Effect.VISCOELASTICITY):
            path = path_for(scene, plan, model=path.model, keeps_all=True)
            passed = PassedStates(path, forces_n[position])
        force_n, solving = forces_n[position], time.perf_counter()
        if walk is None:
            match = _met(scene, plan, path, force_n)
        else:
            match = walk.on_from(path, force_n, stiffer=stiffer, above_n=last_n)
        solve_s, last_n = time.perf_counter() - solving, force_n
        done, fields = _trial(scene, plan, path, worth, (position, force_n), match, solve_s)
        way = (*passed.before(done.force_simulated_n), passed_state(path, match.point))
        trials[position] = done, replace(fields, passed=way)
        say(done.index, f"{done.force_simulated_n:.3f} N at {done.depth_simulated_m * 1e3:.3f} mm")
    ordered = [trials[position] for position in range(len(forces_n))]
    replayed = tuple(trial for trial, _ in ordered)
    wall_s = time.perf_counter() - started + (0.0 if walk is None else walk.took_s)
    replay = Replay(
        name=name,
        trials=replayed,
        model=_replay_model(scene, plan, path, replayed, tolerance, wall_s),
        versions=installed("warp-lang", "numpy", "scipy", "pypardiso", "pytetwild"),
    )
    return replay, [fields for _, fields in ordered]


class _Worth:
    """What the points of a path are worth, from the same path on longer edges beside it."""

    def __init__(self, scene: Scene, plan: EffectPlan) -> None:
        self._scene, self._plan = scene, plan
        self._beside: CoarsePath | RigError
        try:
            self._beside = CoarsePath(*rung(scene, plan))
        except RigError as error:
            self._beside = error

    def of(self, path: LoadingPath, point: PathPoint) -> ErrorEstimate:
        """Push the other path with a point's force; forces do not fall from call to call."""
        if self._plan.is_on(Effect.VISCOELASTICITY):
            alone = replace(self._scene, target=Target(force_n=float(point.force_n[2])))
            return estimated(alone, self._plan, outputs_of(path, point))
        if isinstance(self._beside, RigError):
            return failed(self._beside)
        try:
            coarse = self._beside.push(float(point.force_n[2]))
        except RigError as error:
            self._beside = error
            return failed(error)
        return estimate_from(self._scene, self._plan, outputs_of(path, point), coarse)


def _met(scene: Scene, plan: EffectPlan, path: LoadingPath, force_n: float) -> ForceMatch:
    """Go on to a force [N] in the way that the scene is driven."""
    if plan.is_on(Effect.VISCOELASTICITY):
        match = push_to_force(path, force_n, duration_s=scene.duration_s)
        # On its way a gel that relaxes is pressed quicker than at its end.
        return replace(match, history=match.history[-1:])
    if scene.drive is Drive.LOAD:
        return push_to_force(path, force_n)
    return find_force(path, force_n, tolerance_n=0.1 * scene.force_tolerance_n)


def _trial(
    scene: Scene,
    plan: EffectPlan,
    path: LoadingPath,
    worth: _Worth,
    asked: tuple[int, float],
    match: ForceMatch,
    solve_s: float,
) -> tuple[ReplayTrial, TrialFields]:
    position, force_n = asked
    solved = time.perf_counter()
    fields = trial_fields(path, match.point)
    wall = {"solve_s": solve_s, "fields_s": time.perf_counter() - solved}
    estimated = time.perf_counter()
    error = worth.of(path, match.point)
    wall["estimate_s"] = time.perf_counter() - estimated
    result = measure(scene, path, match.point, plan=plan, wall_s=wall, worth=error)
    trial = ReplayTrial(
        index=position + 1,
        force_measured_n=force_n,
        force_simulated_n=result.force_n[2],
        depth_simulated_m=result.depth_m,
        force_error_estimate=result.estimated_force_error_relative,
        force_error_basis=result.estimated_force_error_basis,
        newton_iterations=match.newton_iterations,
        search_iterations=len(match.history),
        wall_s=result.wall_s,
        balance_relative=result.force_balance_relative,
        gap_min_m=result.gap_min_m,
        min_jacobian=result.min_jacobian,
        force_history=match.history,
    )
    return trial, fields


def _replay_model(
    scene: Scene,
    plan: EffectPlan,
    path: LoadingPath,
    trials: Sequence[ReplayTrial],
    tolerance: Tolerance | None,
    wall_s: float,
) -> ReplayModel:
    """Return what was simulated, what was asked of the force, and the error expected of it."""
    model = path.model
    errors = [trial.force_error_estimate for trial in trials]
    known = [error for error in errors if error is not None]
    largest = max(known) if known and len(known) == len(errors) else None
    return ReplayModel(
        sensor=scene.sensor,
        indenter=describe(scene.indenter),
        centre_x_m=scene.centre_m[0],
        centre_y_m=scene.centre_m[1],
        contact=scene.contact.value,
        friction=scene.friction if scene.contact is ContactMode.FRICTION else None,
        tilt_rad=scene.motion.tilt_rad,
        drive=scene.drive.value,
        law=str(scene.material.law),
        young_pa=scene.material.young_pa,
        poisson=scene.material.poisson,
        layers=tuple(
            ReplayLayer(
                share=layer.share,
                young_pa=layer.material.young_pa,
                poisson=layer.material.poisson,
            )
            for layer in scene.layers
        ),
        preset=str(setting_of(scene)),
        element=model.reference.order.value,
        element_is_linear=model.reference.order is ElementOrder.P1,
        tet_count=len(model.elements),
        node_count=len(model.nodes),
        mesh=model.mesh.name,
        mesh_hash=model.mesh.content_hash,
        barrier_m=scene.contact_distance_m,
        linear_solver=path.solver.factor.name,
        device=model.device,
        setup_s=path.setup_s,
        tolerance=None if tolerance is None else str(tolerance),
        force_error_largest_relative=largest,
        wall_s=wall_s,
        alternatives=alternatives(scene, largest, wall_s=wall_s),
        effects=tuple(plan.as_json()),
    )
