"""A scene as libuipc is given it, and what the presses that come back are worth.

libuipc has linear tetrahedra only, no planes of symmetry, and moves bodies by their place: it gets
our tetrahedra of the whole pad made linear, and goes the depths that our own press of the scene
goes. The gel's law is the same in both engines, so the gel's forces follow from the positions
alone: at the clamped base they are the reaction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from sim.batch.environment import Environment, Trajectory
from sim.device import Device, on_host
from sim.effects.plan import plan_effects
from sim.effects.presets import build_model
from sim.effects.scene_path import path_for
from sim.material.elastic_body import element_constants
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere, cylinder_triangles, tilted
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Effect, Scene
from sim.scene.triangle_surface import TriangleSurface, closed_surface
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.bench.batches import pressing_frames, spread, trajectory_of
from sim.studies.bench.press import moves
from sim.studies.bench.scenes import FRAME_COUNT, ScenePress
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tests.studies.libuipc.task import PeerFound, PeerTask, PeerTolerance

# Of a round body: a ball of 10 mm is up to 2.5 um flatter than it should be where it touches.
_SECTORS, _BALL_RINGS, _FILLET_RINGS = 64, 32, 8
# Every node beneath the indenter carries its share of the force at a gap of 0.6 d_hat, where the
# barrier's force is this times kappa d_hat^3.
_BARRIER_FORCE = 2.93
# Of the pad's height: what lies no deeper below the highest node there may be beneath an indenter.
_TOP_SHARE = 0.1
# The drive's spring gives half of this under 10 N [m].
_AIM_M = 2e-6
# What linear elements of the whole pad differ by from what a scene is pressed with.
_LINEAR_AND_WHOLE = (
    (Effect.SYMMETRY, False),
    (Effect.LOCKING_FREE_ELEMENT, False),
    (Effect.FINITE_STRAIN, True),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerPad:
    """A scene as libuipc is given it.

    Attributes:
        model: Ours on linear tetrahedra of the whole pad.
        trajectory: Where the indenter goes, by depth.
        touch_m: Height of its tip at first touch [m].
        resistance: libuipc's kappa [Pa/m^2].
        stiffness_n_m: dF_z / d(depth) of our press in the last frame that goes down [N/m].
    """

    scene: Scene
    model: Model
    body: TriangleSurface
    trajectory: Trajectory
    touch_m: float
    resistance: float
    stiffness_n_m: float

    def task(self, *, count: int, tolerance: PeerTolerance) -> PeerTask:
        """Return presses in the environments of ``spread``."""
        chosen = spread(self.scene, self.trajectory, count)
        law_pa = on_host(self.gel([each for each, _ in chosen]).parameters)
        poses = np.stack([self._poses(trajectory.goals) for _, trajectory in chosen], axis=1)
        return PeerTask(
            nodes=self.model.nodes,
            tets=self.model.elements,
            clamped=self.model.clamped,
            shear_pa=law_pa[..., 0],
            bulk_pa=law_pa[..., 1],
            start=np.repeat(self._poses(np.zeros((1, 4))), count, axis=0),
            poses=poses,
            body_vertices=self.body.vertices,
            body_faces=self.body.faces,
            distance_m=self.model.contact_options.distance_m,
            resistance=self.resistance,
            friction=self.model.contact_options.friction,
            slip_m=self.model.contact_options.slip_m,
            tolerance=tolerance,
        )

    def gel(self, environments: Sequence[Environment]) -> Any:
        """Return the elements of environments on our model."""
        mesh = self.model.mesh
        return self.model.gel.of(
            [element_constants(mesh, each.materials or ()) for each in environments]
        )

    def _poses(self, goals: FloatArray) -> FloatArray:
        """Return transforms [m], shape [frame_count, 4, 4], at depths, shifts and turns."""
        down, x, y, turn = goals.T
        found = np.tile(np.eye(4), (len(goals), 1, 1))
        about_z = np.tile(np.eye(3), (len(goals), 1, 1))
        about_z[:, 0, 0] = about_z[:, 1, 1] = np.cos(turn)
        about_z[:, 1, 0] = np.sin(turn)
        about_z[:, 0, 1] = -about_z[:, 1, 0]
        found[:, :3, :3] = about_z @ tilted(*self.scene.motion.tilt_rad)
        centre_x, centre_y = self.scene.centre_m
        found[:, :3, 3] = np.column_stack([centre_x + x, centre_y + y, self.touch_m - down])
        return found


def peer_pad(scene: Scene) -> PeerPad:
    """Press a scene by our solver, and mesh its pad for libuipc.

    Raises:
        ConfigError: libuipc cannot do this scene.
        ConvergenceError: Nor can our solver.
    """
    _refuse(scene)
    plan = plan_effects(scene)
    path = path_for(scene, plan)
    points = [move(path) for move in moves(scene)]
    linear = replace(scene, effects=(*scene.effects, *_LINEAR_AND_WHOLE))
    model = build_model(linear, plan=plan_effects(linear))
    trajectory = trajectory_of(scene, frame_count=FRAME_COUNT)
    return PeerPad(
        scene=scene,
        model=model,
        body=triangles(scene.indenter),
        trajectory=replace(
            trajectory, depths_m=np.array([point.depth_m for point in points]), loads_n=None
        ),
        touch_m=path.touch_m,
        resistance=_resistance(model, path, points[-1]),
        stiffness_n_m=points[pressing_frames(scene) - 1].stiffness_n_m,
    )


def _refuse(scene: Scene) -> None:
    lacking = {
        "unbounded plates": isinstance(scene.indenter, Plane),
        "bonded contact": scene.contact is ContactMode.BONDED,
        "relaxation": any(material.relaxation for material in scene.materials),
        "other laws than stable Neo-Hookean": any(
            material.law != LawName.STABLE_NEO_HOOKEAN for material in scene.materials
        ),
    }
    for what, is_needed in lacking.items():
        if is_needed:
            raise ConfigError(f"libuipc has no {what}", remedy="leave this scene to ours")


def triangles(indenter: Indenter) -> TriangleSurface:
    """Return an indenter as libuipc is given it.

    Raises:
        ConfigError: It is a plane.
    """
    if isinstance(indenter, Plane):
        raise ConfigError("a plane has no end", remedy="press a body")
    if not isinstance(indenter, Cylinder | Sphere):
        return indenter.surface
    rings = _FILLET_RINGS
    if isinstance(indenter, Sphere):
        # A cylinder whose end is as round as it can be.
        indenter = Cylinder(diameter_m=indenter.diameter_m, fillet_m=indenter.radius_m)
        rings = _BALL_RINGS
    return closed_surface(
        *cylinder_triangles(indenter, sectors=_SECTORS, fillet_rings=rings), name="indenter"
    )


def _resistance(model: Model, path: LoadingPath, last: PathPoint) -> float:
    """Return kappa that leaves the gel at 0.6 d_hat from the indenter, on average [Pa/m^2]."""
    nodes = model.nodes[np.unique(model.faces)]
    beneath = nodes[np.hypot(*(nodes[:, :2] - path.centre_m).T) < last.contact_radius_m]
    count = int((beneath[:, 2] > beneath[:, 2].max() - _TOP_SHARE * model.height_m).sum())
    distance_m = model.contact_options.distance_m
    return float(last.force_n[2]) / count / (_BARRIER_FORCE * distance_m**3)


def peer_press(pad: PeerPad, task: PeerTask, found: PeerFound) -> ScenePress:
    """Judge the last frame of every environment.

    Returns:
        Force of the first environment, the depth that it was sent to, and the largest imbalance:
        base reaction against libuipc's contact force, over the latter; not a number where libuipc
        does not say that.
    """
    chosen = [each for each, _ in spread(pad.scene, pad.trajectory, task.count)]
    base_n = _elastic(pad, chosen, found.positions)[:, task.clamped].sum(axis=1)
    balance = float("nan")
    if found.contact_n is not None:
        contact_n = found.contact_n.sum(axis=1)
        size_n = np.maximum(np.linalg.norm(contact_n, axis=1), np.finfo(float).tiny)
        balance = float((np.linalg.norm(base_n + contact_n, axis=1) / size_n).max())
    wall_s, cpu_s = min(found.press_s)
    x, y, z = base_n[0]
    return ScenePress(
        preset=task.tolerance.name,
        edges=1.0 / pad.scene.refinement,
        promised=False,
        tet_count=len(task.tets),
        unknown_count=pad.model.pattern.dof_count,
        setup_s=found.set_up_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        iterations=sum(found.newton_iterations),
        force_n=(float(x), float(y), float(z)),
        moment_nm=None,
        depth_m=float(pad.trajectory.along[-1]),
        stiffness_n_m=pad.stiffness_n_m,
        balance=balance,
    )


def strayed(task: PeerTask, found: PeerFound) -> tuple[str, ...]:
    """Say how far an indenter was from where it was sent, if that matters."""
    away_m = float(np.linalg.norm(found.tips_m - task.poses[-1, :, :3, 3], axis=1).max())
    if away_m < _AIM_M:
        return ()
    return (f"an indenter ended {1e6 * away_m:.1f} um from where it was sent",)


def _elastic(
    pad: PeerPad, environments: Sequence[Environment], positions: FloatArray
) -> FloatArray:
    """Return the gradient of the elastic energy [N], shape [count, node_count, 3]."""
    device, gel = Device(pad.model.device), pad.model.gel
    room = gel.buffers(len(environments))
    gel.recorded(
        device.array(np.ones(len(environments)), wp.int32),
        device.array(positions, wp.vec3d),
        room,
        gel=pad.gel(environments),
    ).launch()
    return np.asarray(on_host(room[0]))
