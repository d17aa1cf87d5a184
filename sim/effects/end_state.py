"""The end of a press on a finer mesh than its way.

Load steps need a mesh only for their path; what a press is asked for is its end. The indenter goes
its way on longer edges, and the end state is found on the scene's own mesh by one descent, from the
other mesh's displacements and, with friction, from where its points hold on (nested iteration).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from sim.contact.state import Grip, State
from sim.effects.effect_plan import EffectPlan
from sim.effects.outputs import PressOutputs, outputs_of
from sim.effects.scene_path import follow, path_for
from sim.mesh.elements import EDGES
from sim.scene.scene import ContactMode, Effect, Scene
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError

# Tetrahedra by their centres among which a point's own is looked for, and contact points that
# another one takes what it holds on to from.
_NEAR_TETS, _NEAR_POINTS = 12, 4
# A distance that is none [m], and a weight.
_SAME_PLACE_M, _NOTHING = 1e-7, 1e-9
# What a gel remembers of its whole way, so that no end state of another mesh would do.
_MEMORIES = (Effect.INERTIA, Effect.VISCOELASTICITY)


@dataclass(frozen=True, slots=True, kw_only=True)
class EndState:
    """Where a press ends."""

    path: LoadingPath  # on the scene's own mesh
    point: PathPoint
    # Outputs of the load-step mesh at the same depth or force; None if that is the scene's own mesh
    way: PressOutputs | None = None
    # Path on the load-step mesh, with all states if they are kept; None likewise
    way_path: LoadingPath | None = None


def has_own_way(scene: Scene, plan: EffectPlan) -> bool:
    """Return whether the load steps use another mesh than the end state."""
    return (
        scene.path_refinement is not None
        and scene.contact is not ContactMode.BONDED
        and plan.is_on(Effect.LOCKING_FREE_ELEMENT)
        and not any(plan.is_on(effect) for effect in _MEMORIES)
    )


def way_of(scene: Scene) -> Scene:
    """Return a scene on the mesh of its way."""
    refinement = scene.path_refinement or scene.refinement
    return replace(scene, refinement=refinement, path_refinement=None)


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

    Raises:
        ConvergenceError: No equilibrium, or the force cannot be reached.
        ConfigError: The scene cannot be built.
    """
    path = path_for(scene, plan, model=model, device=device, keeps_all=keeps_all)
    path.options = options or path.options
    if not has_own_way(scene, plan):
        return EndState(path=path, point=follow(scene, path))
    coarse = path_for(way_of(scene), plan, device=device, keeps_all=keeps_all)
    try:
        last = follow(way_of(scene), coarse)
        point = carried_over(scene, coarse, last, path)
    except ConvergenceError:
        return EndState(path=path, point=follow(scene, path))
    path.counts.newton_iterations += coarse.counts.newton_iterations
    path.counts.wall_s += coarse.counts.wall_s
    return EndState(path=path, point=point, way=outputs_of(coarse, last), way_path=coarse)


def carried_over(
    scene: Scene, coarse: LoadingPath, last: PathPoint, path: LoadingPath
) -> PathPoint:
    """Settle a path's last point on another mesh, at the same depth or at the scene's force.

    Raises:
        ConvergenceError: There is no equilibrium near it.
    """
    state = path.untouched(last.depth_m)
    state.tip[:2], state.rotation = last.state.tip[:2], last.state.rotation.copy()
    moved = _interpolated(coarse.model, last.state.positions - coarse.unloaded, path.model.nodes)
    moved[path.model.clamped] = 0.0
    state.positions = path.unloaded + moved
    state.grip = _taken_hold(coarse.model, last.state, path.model, state)
    load_n = scene.target.force_n
    return path.resume(state, load_n=load_n, stiffness_n_m=last.stiffness_n_m)


def _interpolated(model: Model, values: FloatArray, places: FloatArray) -> FloatArray:
    """Return a quadratic model's nodal values at places in or beside its undeformed gel, [n, 3]."""
    corners = model.nodes[model.elements[:, :4]]
    to_shares = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
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
    rest, now = _contact_points(model, model.nodes), _contact_points(model, state.positions)
    away = state.grip.anchors.reshape(-1, 3) - (now - state.tip) @ state.rotation
    held, loads = state.grip.held.reshape(-1), state.grip.loads.reshape(-1, 3)
    distance, near = scipy.spatial.KDTree(rest).query(
        _contact_points(other, other.nodes), k=_NEAR_POINTS
    )
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


def _contact_points(model: Model, positions: FloatArray) -> FloatArray:
    """Return the contact points [m], shape [count, 3]."""
    points = model.reference.face_values @ positions[model.faces]
    return np.asarray(points.reshape(-1, 3))
