"""Replay of a run's measured forces on one model, one loading path for all of them.

A law's energy, the contact's and friction's all scale with Young's modulus: at k times the force, a
gel k times as stiff is deformed as the other one was. So one loading path of a reference gel gives
depths, from these the gel's modulus, and the stiffer gel is pressed on from the states of that path
with a step to each force.

What presses raises ConvergenceError where a force cannot be reached, with how far it got, and
TimeLimitError where one press takes longer than it may.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from sim.cheapest_setting import alternatives, corrected_scene, setting_of
from sim.effects.effect_choice import plan_effects
from sim.effects.planned_effects import EffectPlan
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import CoarsePath, end_state, path_for
from sim.error_estimate import ErrorEstimate, coarse_reference, estimate_from, estimated, failed
from sim.fields.saved_press import IntermediateStates, TrialFields, intermediate_state, trial_fields
from sim.mesh.elements import ElementOrder
from sim.mesh_bias_correction import correction
from sim.press import PressResult, measure
from sim.scene.indenter import Indenter, describe
from sim.scene.scene import ContactMode, Drive, Effect, Motion, Output, Scene, Target
from sim.sensor.sensor import Sensor
from sim.solve.force_search import ForceMatch, find_force
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint
from sim.tilt_sensitivity import NO_FORCE_N
from sim.tolerance import Tolerance
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.simulated import Replay, ReplayLayer, ReplayModel, ReplayTrial
from tacauchy_rig.core.time_limit_and_progress import time_limit
from tacauchy_rig.core.versions import installed

History = tuple[tuple[float, float], ...]
"""(depth [m], F_z [N])."""
# Of a force: so much at least is left to be pushed.
_FORCE_LEFT_SHARE = 1e-3
_PATH_DEPENDENT = (Effect.GRAVITY, Effect.INERTIA, Effect.VISCOELASTICITY)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferencePath:
    """The loading path of a reference gel to some forces."""

    scene: Scene
    plan: EffectPlan
    path: LoadingPath
    # Along the path; of a gel that relaxes, pressed anew for each force, at the forces only
    history: History
    took_s: float  # by the wall or the processor, whichever is less [s]: others may have worked

    def is_usable_for(self, scene: Scene, plan: EffectPlan) -> bool:
        """Return whether a press of another stiffness may continue from states of this path."""
        return (
            scene.drive is Drive.LOAD
            and setting_of(scene) == setting_of(self.scene)
            and plan.switches == self.plan.switches
            and not path_depends_on_modulus(plan)
        )

    def continue_to(
        self, path: LoadingPath, force_n: float, *, stiffer: float, above_n: float
    ) -> ForceMatch:
        """Push a stiffer gel's path to a force [N], from the state of this one next below it.

        The match reports the states above the force before, ``above_n`` [N].
        """
        # Starting at the force itself would leave a step of the size of rounding errors.
        most_n = (1.0 - _FORCE_LEFT_SHARE) * force_n / stiffer
        known = [point for point in self.path.points if 0.0 < point.force_n[2] <= most_n]
        start = max(known, key=lambda point: float(point.force_n[2]), default=None)
        taken = None if start is None else path.taken_over(start, stiffer=stiffer)
        match = ForceMatch.of(path, partial(path.push, force_n, start=taken))
        curve = ((depth, stiffer * force) for depth, force in self.history)
        passed = tuple(each for each in curve if above_n < each[1] < force_n)
        return replace(match, history=passed + match.history[-1:])


def path_depends_on_modulus(plan: EffectPlan) -> bool:
    """Return whether a stiffer gel, or another duration, changes the loading path."""
    return any(plan.is_on(effect) for effect in _PATH_DEPENDENT)


def reference_path(scene: Scene, forces_n: Sequence[float], *, keep_states: bool) -> ReferencePath:
    """Press a scene's indenter to the largest of some forces [N], without fields.

    Args:
        scene: As ``replay_scene`` makes it.
        keep_states: Take the steps of a replay and keep all states. Else steps are as long as the
            force allows, without the limits for shear and markers.
    """
    started, plan = (time.perf_counter(), time.process_time()), plan_effects(scene)
    if not keep_states:
        scene = replace(scene, outputs=frozenset({Output.FORCE}))
    relaxes = plan.is_on(Effect.VISCOELASTICITY)
    path = path_for(scene, plan, keeps_all=keep_states and not relaxes)
    history: History = ()
    if not relaxes:
        path.push(max(forces_n))
        history = tuple(path.history)
    for force_n in sorted(forces_n) if relaxes else ():
        path = path_for(scene, plan, model=path.model)
        history += _met(scene, plan, path, force_n).history
    took_s = min(time.perf_counter() - started[0], time.process_time() - started[1])
    return ReferencePath(scene=scene, plan=plan, path=path, history=history, took_s=took_s)


def replay_scene(
    sensor: Sensor,
    indenter: Indenter,
    forces_n: Sequence[float],
    *,
    tolerance_n: float = 0.08,
    friction: float = 0.0,
    tilt_rad: tuple[float, float] = (0.0, 0.0),
    **further: Any,
) -> Scene:
    """Return the press to the largest of some forces, with further fields of a scene.

    Args:
        forces_n: Pressing forces [N].
        tolerance_n: Largest |F_z simulated - measured| [N].
        tilt_rad: Rotations of the indenter about x and y [rad].
    """
    return sensor.scene(
        indenter,
        Target(force_n=max([0.0, *forces_n])),
        force_tolerance_n=tolerance_n,
        contact=ContactMode.FRICTION if friction else ContactMode.FRICTIONLESS,
        friction=friction,
        motion=Motion(tilt_rad=tilt_rad),
        outputs=frozenset(Output),
        **further,
    )


def replay_forces(
    scene: Scene,
    forces_n: Sequence[float],
    *,
    tolerance: Tolerance | None = None,
    on_progress: Callable[[int, str], None] | None = None,
    name: str = "force-matched",
    reference: ReferencePath | None = None,
    stiffer: float = 1.0,
    depths_from_n: float | None = None,
    time_limit_s: float | None = None,
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
        reference: Another gel's loading path to these forces: where it is usable, each force is
            reached from its states.
        stiffer: How many times as stiff as that gel this one is.
        depths_from_n: Press to depths [m] in place of forces, which count from where the gel
            carries this force [N]; 0 is first touch.
        time_limit_s: How long one press may take [s].

    Returns:
        The replay, and the fields of each trial in the order of ``forces_n``.
    """
    say = on_progress or (lambda _index, _text: None)
    started = time.perf_counter()
    plan = plan_effects(scene)
    if reference is not None and not reference.is_usable_for(scene, plan):
        reference = None
    largest_n = max(forces_n, default=0.0)
    if reference is None:
        path = path_for(scene, plan, keeps_all=True)
        passed = IntermediateStates(path, largest_n)
    else:
        path = reference.path.stiffer(stiffer)
        passed = IntermediateStates(reference.path, largest_n, stiffer=stiffer)
    touch = 0.0
    if depths_from_n and depths_from_n > NO_FORCE_N:
        touch = path.push(depths_from_n).depth_m
    evaluation, last_n = _Evaluation(scene, plan), 0.0
    duration_s = scene.duration_s if plan.is_on(Effect.VISCOELASTICITY) else None
    trials: dict[int, tuple[ReplayTrial, TrialFields]] = {}
    for position in sorted(range(len(forces_n)), key=lambda k: forces_n[k]):
        if plan.is_on(Effect.VISCOELASTICITY):
            path = path_for(scene, plan, model=path.model, keeps_all=True)
            passed = IntermediateStates(path, forces_n[position])
        force_n, solving = forces_n[position], time.perf_counter()
        with time_limit(time_limit_s):
            if depths_from_n is not None:
                deepen = partial(path.advance, touch + force_n, duration_s=duration_s)
                match = ForceMatch.of(path, deepen)
                passed = IntermediateStates(path, float(match.point.force_n[2]))
            elif reference is None:
                match = _met(scene, plan, path, force_n)
            else:
                match = reference.continue_to(path, force_n, stiffer=stiffer, above_n=last_n)
            solve_s, last_n = time.perf_counter() - solving, force_n
            done, fields = evaluation.trial(path, position + 1, force_n, match, solve_s)
            if depths_from_n is not None:
                done = replace(done, depth_simulated_m=done.depth_simulated_m - touch)
        states = (*passed.before(done.force_simulated_n), intermediate_state(path, match.point))
        trials[position] = done, replace(fields, intermediate=states)
        say(done.index, f"{done.force_simulated_n:.3f} N at {done.depth_simulated_m * 1e3:.3f} mm")
    ordered = [trials[position] for position in range(len(forces_n))]
    replayed = tuple(trial for trial, _ in ordered)
    wall_s = time.perf_counter() - started + (0.0 if reference is None else reference.took_s)
    replay = _replay(name, scene, plan, path, replayed, tolerance, wall_s)
    return replay, [fields for _, fields in ordered]


class _Evaluation:
    """What is kept of points of a path, with errors estimated from the path on longer edges."""

    def __init__(self, scene: Scene, plan: EffectPlan) -> None:
        self._scene, self._plan = scene, plan
        self._coarser: CoarsePath | None = None
        self._failure: RigError | None = None

    def trial(
        self, path: LoadingPath, index: int, force_n: float, match: ForceMatch, solve_s: float
    ) -> tuple[ReplayTrial, TrialFields]:
        """Evaluate the press for a measured force [N]; forces do not fall from call to call."""
        wall, started = {"solve_s": solve_s}, time.perf_counter()
        fields = trial_fields(path, match.point)
        wall["fields_s"], started = time.perf_counter() - started, time.perf_counter()
        error = self._error(path, match.point)
        wall["estimate_s"] = time.perf_counter() - started
        result = measure(self._scene, path, match.point, plan=self._plan, wall_s=wall, error=error)
        return _record(index, force_n, match, result), fields

    def _error(self, path: LoadingPath, point: PathPoint) -> ErrorEstimate:
        force_n, found = float(point.force_n[2]), outputs_of(path, point)
        if self._plan.is_on(Effect.VISCOELASTICITY):
            alone = replace(self._scene, target=Target(force_n=force_n))
            return estimated(alone, self._plan, found)
        if self._failure is not None:
            return failed(self._failure)
        try:
            self._coarser = self._coarser or CoarsePath(*coarse_reference(self._scene, self._plan))
            coarse = self._coarser.push(force_n)
        except RigError as error:
            self._failure = error
            return failed(error)
        return estimate_from(self._scene, self._plan, found, coarse)


def replay_alone(
    scene: Scene,
    *,
    tolerance: Tolerance,
    name: str = "force-matched",
    time_limit_s: float | None = None,
) -> tuple[Replay, TrialFields] | None:
    """Press once to a scene's force or depth, on the cheapest mesh whose bias is known.

    The depth, or the force at a given depth, is corrected for that bias; fields and surface are the
    mesh's own. None where no bias is known that leaves the tolerance.
    """
    cheapest = corrected_scene(scene, tolerance)
    if cheapest is None:
        return None
    scene, started = cheapest, time.perf_counter()
    with time_limit(time_limit_s):
        plan = plan_effects(scene)
        end = end_state(scene, plan, keeps_all=True)
        corrected = correction(scene, plan, outputs_of(end.path, end.point), end.way)
        if corrected is None or end.way_path is None:
            return None
        solve_s, solved = time.perf_counter() - started, time.perf_counter()
        fields = trial_fields(end.path, end.point)
        wall = {"solve_s": solve_s, "fields_s": time.perf_counter() - solved, "estimate_s": 0.0}
        result = measure(scene, end.path, end.point, plan=plan, wall_s=wall, corrected=corrected)
    corrected = result.corrected or corrected
    force_n, depth_m = corrected.force_n, corrected.depth_m
    way = end.way_path.history
    raised = force_n / way[-1][1], depth_m / way[-1][0]
    history = *((raised[1] * d, raised[0] * f) for d, f in way[:-1]), (depth_m, force_n)
    share = 1.0
    if scene.target.force_n is not None:
        share = max(1.0, end.point.stiffness_n_m * depth_m / force_n)
    match = ForceMatch(point=end.point, history=history, newton_iterations=result.newton_iterations)
    trial = replace(
        _record(1, force_n, match, result),
        force_simulated_n=force_n,
        depth_simulated_m=depth_m,
        force_error_estimate=share * corrected.error_relative,
        force_error_basis=corrected.basis,
    )
    states = IntermediateStates(end.way_path, force_n).before(force_n)
    fields = replace(fields, intermediate=(*states, intermediate_state(end.path, end.point)))
    wall_s = time.perf_counter() - started
    return _replay(name, scene, plan, end.path, (trial,), tolerance, wall_s), fields


def _met(scene: Scene, plan: EffectPlan, path: LoadingPath, force_n: float) -> ForceMatch:
    """Go on to a force [N] in the way that the scene is driven."""
    if plan.is_on(Effect.VISCOELASTICITY):
        match = ForceMatch.of(path, partial(path.push, force_n, duration_s=scene.duration_s))
        # Before its end a gel that relaxes is pressed more quickly than at its end.
        return replace(match, history=match.history[-1:])
    if scene.drive is Drive.LOAD:
        return ForceMatch.of(path, partial(path.push, force_n))
    return find_force(path, force_n, tolerance_n=0.1 * scene.force_tolerance_n)


def _record(index: int, force_n: float, match: ForceMatch, result: PressResult) -> ReplayTrial:
    """Return what is kept of a press for a measured force [N]."""
    return ReplayTrial(
        index=index,
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


def _replay(
    name: str,
    scene: Scene,
    plan: EffectPlan,
    path: LoadingPath,
    trials: tuple[ReplayTrial, ...],
    tolerance: Tolerance | None,
    wall_s: float,
) -> Replay:
    """Return the trials, what was simulated, what was asked of the force, and its error."""
    model = path.model
    errors = [trial.force_error_estimate for trial in trials]
    known = [error for error in errors if error is not None]
    largest = max(known) if known and len(known) == len(errors) else None
    facts = ReplayModel(
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
                share=layer.share, young_pa=layer.material.young_pa, poisson=layer.material.poisson
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
    versions = installed("warp-lang", "numpy", "scipy", "pypardiso", "pytetwild")
    return Replay(name=name, trials=trials, model=facts, versions=versions)
