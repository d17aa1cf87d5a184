"""The path of a scene's indenter with the effects of a plan, and the end of a press.

A path on longer edges ends on the scene's own mesh by one descent, from the other mesh's
displacements and, with friction, from where its points hold on (nested iteration).

All that presses raises ConvergenceError where there is no equilibrium or a force cannot be reached,
and ConfigError where a scene cannot be built or its gel has no room for the depth.
"""

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import scipy

from sim.contact.surface_and_grip import Grip, State
from sim.effects.depth_and_inertia_scales import expected_depth, inertia_error, most_force
from sim.effects.mesh_choice import sharp_edge_m
from sim.effects.planned_effects import EffectPlan, full_plan
from sim.effects.presets import ROUNDER, build_model, regularised_indenter, slips
from sim.effects.press_outputs import PressOutputs, outputs_of
from sim.mesh.elements import EDGES
from sim.scene.indenter import MeshIndenter, tilted
from sim.scene.scene import ContactMode, Drive, Effect, Output, Preset, Scene
from sim.solve.equilibrium import EXTENSIONS, SolverOptions, rough_reuse
from sim.solve.force_search import find_force
from sim.solve.load_steps import STEP_SHARE
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.solve.weight_and_inertia import Inertia, weight
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError, ConvergenceError
from tacauchy_rig.core.time_limit_and_progress import doing

# Residual over the contact force of a press with a wide barrier; where a tolerance is asked for, a
# thousandth of it, at most, and a load is then met no closer than that.
_ROUGHLY, _ROUGHER, _OF_TOLERANCE = 1e-6, 1e-4, 1e-3
# Residual of an end with a way of its own, on edges of preset fast and on longer ones; on shorter
# ones it is ``_ROUGHER``. F_z of eight presses changed by at most 0.1 % by each.
_ROUGH_END, _ROUGHEST_END = 2e-4, 1e-3
# A way may be so many times as rough as its end.
_WAY_ROUGHER = 10.0
# Where a tolerance leaves a way as much as this, its steps are so many times longer: with the rough
# ends, F_z of 40 drawn presses at 5 % changes by -0.84 to +0.45 %, under a tilted punch by -1.7 %.
# Such a way ends with the last of these as its residual.
_ROUGH_FROM, _ROUGH_STEPS, _NOT_ROUGH, _ROUGH_WAY = 0.1, 4.0, 0.099, 1e-3
# What depends on the way that points slide or take hold. Where it is asked for, steps are so many
# times shorter: three balls' shear with mu 0.5 is then 0.2 to 0.6 % of the pressure off, not 0.8 to
# 2.0 %, for 1.3 to 1.8 times the time.
_PATH_DEPENDENT = {Output.SHEAR, Output.MARKERS}
_PATH_DEPENDENT_STEPS = 4.0
# So many steps at least, and as many as this over the tolerance. Gel under a ball 2 % deep moves
# otherwise by 18 % in two steps than in sixty, by 4 % in ten and by 1.4 % in twenty.
_STEPS_LEAST, _STEPS_BY_TOLERANCE = 10.0, 0.6
# Time steps of a press, and of a motion, with inertia.
TIME_STEPS = 60


def path_for(
    scene: Scene,
    plan: EffectPlan,
    *,
    model: Model | None = None,
    refinement: float = 1.0,
    keeps_all: bool = False,
    device: str = "cpu",
) -> LoadingPath:
    """Return the path that a scene's indenter will go, with the planned effects.

    A model is reused; without one the scene is meshed, every edge ``refinement`` times shorter.

    Raises:
        ConfigError: The scene cannot be built, or its force is far beyond what the gel carries.
    """
    force_n = scene.target.force_n
    if force_n is not None and force_n > most_force(scene):
        raise ConfigError(
            f"a force of {force_n:g} N is more than the gel can carry: by a coarse estimate less "
            f"than {most_force(scene):.3g} N press the indenter to its base",
            remedy="press with less force",
        )
    if model is None:
        with doing("meshing"):
            model = build_model(scene, plan=plan, refinement=refinement, device=device)
    density = np.array([each.density_kg_m3 for each in scene.materials])[model.mesh.labels]
    step_s = _longer(scene) * scene.duration_s / TIME_STEPS
    rounded = partial(regularised_indenter, scene, refinement=refinement)
    return LoadingPath(
        model,
        rounded(),
        scene.centre_m,
        rotation=tilted(*scene.motion.tilt_rad),
        step_max_m=_longest_step(scene, plan, height_m=model.height_m),
        potential=weight(model, density) if plan.is_on(Effect.GRAVITY) else None,
        inertia=Inertia(model, density, step_max_s=step_s) if plan.is_on(Effect.INERTIA) else None,
        options=_options(scene),
        reuse=rough_reuse(model.pattern.dof_count) if scene.has_wide_barrier else None,
        keeps_all=keeps_all,
        rounder=rounded(wider=ROUNDER) if slips(scene) else None,
    )


def _longer(scene: Scene) -> float:
    """Return how many times longer than usual a scene's steps are."""
    is_rough = scene.has_wide_barrier and (scene.tolerance or 0.0) >= _ROUGH_FROM
    return _ROUGH_STEPS if is_rough else 1.0


def _longest_step(scene: Scene, plan: EffectPlan, *, height_m: float) -> float:
    """Return how far the indenter goes in a step at most [m]."""
    longest, asked = _longer(scene) * STEP_SHARE * height_m, _PATH_DEPENDENT & scene.outputs
    holds = scene.contact is ContactMode.BONDED or plan.is_on(Effect.FRICTION)
    if not asked or not holds:
        return longest
    closest = min(plan.tolerances.get(output, 1.0) for output in asked)
    steps = max(_STEPS_LEAST, _STEPS_BY_TOLERANCE / closest)
    return min(longest / _PATH_DEPENDENT_STEPS, expected_depth(scene) / steps)


def _options(scene: Scene) -> SolverOptions:
    """Return how closely a scene's forces are to balance."""
    if not scene.has_wide_barrier:
        return SolverOptions()
    if scene.tolerance is None:
        return SolverOptions(residual_relative=_ROUGHLY)
    share = min(_ROUGHER, max(_ROUGHLY, _OF_TOLERANCE * scene.tolerance))
    end = _ROUGHEST_END if scene.refinement < 1.0 else _ROUGH_END
    end = _ROUGHER if scene.refinement > 1.0 else end
    way = _ROUGH_WAY if _longer(scene) > 1.0 else share
    residual = way if scene.path_refinement is None else end
    return SolverOptions(residual_relative=residual, load_relative=share)


def follow(scene: Scene, path: LoadingPath) -> PathPoint:
    """Take the indenter to the scene's depth or force, then along its motion.

    Returns:
        The end; its stiffness is that of the way down, as what slides under a load sinks anyhow.
    """
    depth, force = scene.target.depth_m, scene.target.force_n
    if depth is not None:
        point = path.advance(depth, duration_s=scene.duration_s)
    elif scene.drive is Drive.LOAD:
        point = path.push(force or 0.0, duration_s=scene.duration_s)
    else:
        point = find_force(path, force or 0.0, tolerance_n=scene.force_tolerance_n).point
    motion = scene.motion
    if motion.moves:
        carried = path.carry(
            shift_m=motion.shift_m,
            twist_rad=motion.twist_rad,
            hold=Hold.DEPTH if depth is not None else Hold.FORCE,
            duration_s=scene.duration_s,
        )
        return replace(carried, stiffness_n_m=point.stiffness_n_m)
    return point


# Effects are tried on the scene's own press on longer edges, and errors estimated from it, which
# costs a small part of it. How many times shorter the edges are, the coarsest first; preset paper
# has but one mesh.
COARSE_RATIOS: dict[Preset, tuple[float, ...]] = {
    Preset.FAST: (0.5,),
    Preset.BALANCED: (1.0 / 3.0, 0.5),
    Preset.ACCURATE: (1.0 / 3.0, 0.5),
    Preset.REFERENCE: (1.0 / 3.0, 0.5),
    Preset.PAPER: (),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarsePress:
    """A press on longer edges."""

    ratio: float  # how many times shorter than the scene's its edges are
    outputs: PressOutputs
    processor_s: float = 0.0  # what it cost [s], where effects are tried by it


def coarse_press(scene: Scene, plan: EffectPlan, ratio: float) -> CoarsePress:
    """Press a scene with a plan's effects on longer edges, at most as short as its way's."""
    # Without what does not change a press on given edges, so that more scenes share it.
    bare = replace(scene, effects=plan.switches, tolerance=None, outputs=frozenset(), sensor="")
    if scene.path_refinement is not None:
        ratio = min(ratio, scene.path_refinement / scene.refinement)
    return _pressed(replace(bare, path_refinement=None), ratio)


def forget() -> None:
    """Forget every coarse press, so that the next ones are timed."""
    _pressed.cache_clear()


class CoarsePath:
    """A scene's path on edges ``ratio`` times shorter, pushed from force to force."""

    def __init__(self, scene: Scene, plan: EffectPlan, ratio: float) -> None:
        self._ratio = ratio
        self._path = path_for(replace(scene, refinement=ratio * scene.refinement), plan)

    def push(self, force_n: float) -> CoarsePress:
        """Push on to a force [N]."""
        outputs = outputs_of(self._path, self._path.push(force_n))
        return CoarsePress(ratio=self._ratio, outputs=outputs)


@lru_cache(maxsize=64)
def _pressed(scene: Scene, ratio: float) -> CoarsePress:
    started = time.process_time()
    coarse = replace(scene, refinement=ratio * scene.refinement)
    plan = full_plan(coarse)
    with doing("a coarse press, to choose effects and estimate errors"):
        path = path_for(coarse, plan)
        outputs = outputs_of(path, follow(coarse, path))
    return CoarsePress(ratio=ratio, outputs=outputs, processor_s=time.process_time() - started)


# Tetrahedra by their centres among which a point's own is looked for, and contact points that
# another one takes what it holds on to from.
_NEAR_TETS, _NEAR_POINTS = 12, 4
# Share of the depth or force after which the end state's mesh takes the load steps. Three punches
# that half slip were 0.4 to 1.5 % of F_z off where it took none, with this 0.0 to 0.3 %.
ON_WAY = 0.6
# A distance that is none [m], and a weight.
_SAME_PLACE_M, _NOTHING = 1e-7, 1e-9
# Share of d_hat below which the barrier is a parabola, at an end under sharp triangles: gel starts
# inside of them, and a softer barrier lets corners through.
_FIRM = 0.03
# What inertia changes at most where a press ends at rest; it then only chooses among equilibria.
_AT_REST = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class EndState:
    """Where a press ends."""

    path: LoadingPath  # on the scene's own mesh
    point: PathPoint
    # Outputs of another mesh at the same depth or force; None if there was none
    way: PressOutputs | None = None
    # Path on the load-step mesh, with all states if they are kept; None if that is the scene's own
    way_path: LoadingPath | None = None


def has_own_way(scene: Scene, plan: EffectPlan) -> bool:
    """Return whether the load steps use another mesh than the end state.

    It does not where a gel remembers its whole way.
    """
    ends_moving = plan.is_on(Effect.INERTIA) and (inertia_error(scene) or 1.0) > _AT_REST
    return (
        scene.path_refinement is not None
        and scene.contact is not ContactMode.BONDED
        and plan.is_on(Effect.LOCKING_FREE_ELEMENT)
        and not plan.is_on(Effect.VISCOELASTICITY)
        and not ends_moving
    )


def way_of(scene: Scene) -> Scene:
    """Return a scene on the mesh of its way."""
    refinement = scene.path_refinement or scene.refinement
    rougher = scene.tolerance and _WAY_ROUGHER * scene.tolerance
    if rougher and scene.refinement <= 1.0:
        rougher = max(rougher, _ROUGH_FROM)
    return replace(scene, refinement=refinement, path_refinement=None, tolerance=rougher)


def end_state(
    scene: Scene,
    plan: EffectPlan,
    *,
    model: Model | None = None,
    options: SolverOptions | None = None,
    device: str = "cpu",
    keeps_all: bool = False,
) -> EndState:
    """Take a scene's indenter to its end.

    Args:
        model: Of the scene's own mesh; None makes it.
        options: How closely forces are to balance; None is the scene's choice.
        keeps_all: Keep every equilibrium on the way.
    """
    path = path_for(scene, plan, model=model, device=device, keeps_all=keeps_all)
    path.options = options or path.options
    if not has_own_way(scene, plan):
        return EndState(path=path, point=follow(scene, path))
    rough = way_of(scene)
    # Long steps may lead a way into folds that its end cannot be settled from; shorter ones do not.
    shorter = replace(rough, tolerance=rough.tolerance and min(rough.tolerance, _NOT_ROUGH))
    for way in dict.fromkeys((rough, shorter)):
        coarse = path_for(way, plan, device=device, keeps_all=keeps_all)
        with suppress(ConvergenceError):
            on_way = follow(part_on_way(way), coarse) if goes_on(scene, plan) else None
            last = follow(way, coarse)
            point = ended(scene, coarse, on_way or last, last, path)
            path.counts.newton_iterations += coarse.counts.newton_iterations
            path.counts.wall_s += coarse.counts.wall_s
            return EndState(path=path, point=point, way=outputs_of(coarse, last), way_path=coarse)
    return EndState(path=path, point=follow(scene, path))


def on_own_mesh(scene: Scene, plan: EffectPlan, end: EndState, *, keeps_all: bool) -> EndState:
    """Take a scene's indenter to its end again, as roughly as on the way, on the end's own mesh."""
    own = way_of(replace(scene, path_refinement=None))
    path = path_for(own, plan, model=end.path.model, keeps_all=keeps_all)
    return EndState(path=path, point=follow(own, path), way=end.way)


def goes_on(scene: Scene, plan: EffectPlan) -> bool:
    """Return whether an end state's own mesh takes the last load steps, too.

    With friction, what has slid depends on them; a motion makes all slide once more. The bias
    under triangles and sharp rims was fitted without them.
    """
    is_smooth = not isinstance(scene.indenter, MeshIndenter) and not scene.has_sharp_rim
    by_steps = scene.target.depth_m is not None or scene.drive is Drive.LOAD
    return plan.is_on(Effect.FRICTION) and is_smooth and by_steps and not scene.motion.moves


def part_on_way(scene: Scene) -> Scene:
    """Return a scene that ends where its own mesh takes over the load steps."""
    target = scene.target
    if target.depth_m is not None:
        return replace(scene, target=replace(target, depth_m=ON_WAY * target.depth_m))
    return replace(scene, target=replace(target, force_n=ON_WAY * (target.force_n or 0.0)))


def ended(
    scene: Scene, coarse: LoadingPath, on_way: PathPoint, last: PathPoint, path: LoadingPath
) -> PathPoint:
    """Settle a way's point on another mesh and, unless it is the last, go on there to the end."""
    if on_way is last:
        return carried_over(scene, coarse, last, path)
    carried_over(part_on_way(scene), coarse, on_way, path)
    return replace(follow(scene, path), stiffness_n_m=last.stiffness_n_m)


def carried_over(
    scene: Scene, coarse: LoadingPath, last: PathPoint, path: LoadingPath
) -> PathPoint:
    """Settle a path's last point on another mesh, at the same depth or at the scene's force."""
    state = path.untouched(last.depth_m)
    state.tip[:2], state.rotation = last.state.tip[:2], last.state.rotation.copy()
    moved = _interpolated(coarse.model, last.state.positions - coarse.unloaded, path.model.nodes)
    moved[path.model.clamped] = 0.0
    state.positions = path.unloaded + moved
    state.grip = _taken_hold(coarse.model, last.state, path.model, state)
    # Where a wider barrier would not do here either; under cylinders it often does.
    if isinstance(scene.indenter, MeshIndenter) or last.state.extension < EXTENSIONS[0]:
        firm = _FIRM if isinstance(scene.indenter, MeshIndenter) and sharp_edge_m(scene) else 1.0
        state.extension = min(last.state.extension, firm)
    return path.resume(state, load_n=scene.target.force_n, stiffness_n_m=last.stiffness_n_m)


def _interpolated(model: Model, values: FloatArray, places: FloatArray) -> FloatArray:
    """Return a quadratic model's nodal values at places in or beside its undeformed gel, [n, 3]."""
    corners = model.nodes[model.elements[:, :4]]
    to_shares = model.discretisation.inverse_jacobians
    count = min(_NEAR_TETS, len(corners))
    _, near = scipy.spatial.KDTree(corners.mean(axis=1)).query(places, k=count)
    near = np.asarray(near).reshape(len(places), count)
    inner = np.einsum("nkij,nkj->nki", to_shares[near], places[:, None] - corners[near, 0])
    shares = np.concatenate([1.0 - inner.sum(axis=2, keepdims=True), inner], axis=2)
    own = shares.min(axis=2).argmax(axis=1)
    rows = np.arange(len(places))
    found = np.clip(shares[rows, own], 0.0, None)
    found /= found.sum(axis=1, keepdims=True)
    middles = [4.0 * found[:, a] * found[:, b] for a, b in EDGES]
    shape = np.column_stack([found * (2.0 * found - 1.0), *middles])
    return np.asarray(np.einsum("nk,nki->ni", shape, values[model.elements[near[rows, own]]]))


def _taken_hold(model: Model, state: State, other: Model, moved: State) -> Grip | None:
    """Return what another mesh's points hold on to: as far off as those of the nearest points."""
    free = other.surface.free_grip(moved.positions, moved.tip, moved.rotation)
    if free is None or state.grip is None:
        return None
    both = (model.nodes, state.positions)
    rest, now = (model.surface.points(nodes).reshape(-1, 3) for nodes in both)
    away = state.grip.anchors.reshape(-1, 3) - (now - state.tip) @ state.rotation
    held, loads = state.grip.held.reshape(-1), state.grip.loads.reshape(-1, 3)
    places = other.surface.points(other.nodes).reshape(-1, 3)
    distance, near = scipy.spatial.KDTree(rest).query(places, k=_NEAR_POINTS)
    weight = held[near] / (distance + _SAME_PLACE_M) ** 2
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), _NOTHING)
    own = held[near[:, 0]]
    mixed_away, mixed_loads = (
        (own[:, None] * np.einsum("nk,nki->ni", weight, each[near])).reshape(free.anchors.shape)
        for each in (away, loads)
    )
    return Grip(
        held=own.reshape(free.held.shape), anchors=free.anchors + mixed_away, loads=mixed_loads
    )
