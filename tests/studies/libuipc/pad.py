"""A scene as libuipc is given it, and what the presses that come back are worth.

libuipc has linear tetrahedra only, no planes of symmetry, and moves bodies by their place: it gets
our tetrahedra of the whole pad made linear, and goes the depths that our own press of the scene
goes. The gel's law is the same in both engines, so the gel's forces follow from the positions
alone: at the clamped base they are the reaction.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device, on_host
from sim.effects.effect_choice import plan_effects
from sim.effects.presets import build_model
from sim.effects.press_with_effects import path_for
from sim.material.elastic_body import element_constants
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere, cylinder_triangles, tilted
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Effect, Scene
from sim.scene.triangle_surface import TriangleSurface, closed_surface
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.bench.scenes import ScenePress
from sim.studies.bench.timed_press import goals_of, moves, pressing_frames, spread
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# Of a round body: a ball of 10 mm is up to 2.5 um flatter than it should be where it touches.
_SECTORS, _BALL_RINGS, _FILLET_RINGS = 64, 32, 8
# Every node beneath the indenter carries its share of the force at a gap of 0.6 d_hat, where the
# barrier's force is this times kappa d_hat^3.
_BARRIER_FORCE = 2.93
# Of the pad's height: what lies no deeper below the highest node there may be beneath an indenter.
_TOP_SHARE = 0.1
# The drive's spring gives half of this under 10 N [m].
_AIM_M = 2e-6
# Pads lie so far apart, in units of their largest extent.
_APART = 2.5
# What linear elements of the whole pad differ by from what a scene is pressed with.
_LINEAR_AND_WHOLE = (
    (Effect.SYMMETRY, False),
    (Effect.LOCKING_FREE_ELEMENT, False),
    (Effect.FINITE_STRAIN, True),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerPad:
    """A scene as libuipc is given it."""

    scene: Scene
    model: Model  # ours on linear tetrahedra of the whole pad
    body: TriangleSurface
    goals: FloatArray  # depths, shifts [m] and turns [rad] of the frames, shape [frame_count, 4]
    touch_m: float  # height of its tip at first touch
    resistance: float  # kappa [Pa/m^2]: energy kappa (d^2 - d_hat^2)^2 ln (d_hat/d)^2 of a pair
    stiffness_n_m: float  # dF_z / d(depth) of our press in the last frame that goes down

    def poses(self, goals: FloatArray) -> FloatArray:
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


class PeerPresses:
    """Presses of one pad in the environments of ``spread``, side by side in one libuipc scene.

    Attributes:
        shear_pa: Of the law's m, of every tetrahedron of every environment, [count, tet_count].
        bulk_pa: Of its l, likewise.
        start: Of the indenters at first touch, as transforms [m], shape [count, 4, 4].
        poses: Likewise in every frame, shape [frame_count, count, 4, 4].
        origins_m: Where every environment's pad lies, shape [count, 3]: on a square grid.
    """

    def __init__(self, pad: PeerPad, count: int) -> None:
        gels, shares = spread(pad.scene, count)
        self.pad, self.count = pad, count
        self._gel = pad.model.gel.of([element_constants(pad.model.mesh, each) for each in gels])
        law_pa = on_host(self._gel.parameters)
        self.shear_pa, self.bulk_pa = law_pa[..., 0], law_pa[..., 1]
        self.start = np.repeat(pad.poses(np.zeros((1, 4))), count, axis=0)
        less = [pad.goals * [share, 1.0, 1.0, 1.0] for share in shares.tolist()]
        self.poses = np.stack([pad.poses(goals) for goals in less], axis=1)
        columns, number = int(np.ceil(np.sqrt(count))), np.arange(count)
        pitch = _APART * float(np.ptp(pad.model.nodes, axis=0).max())
        x, y = (
            pitch * (place - 0.5 * (columns - 1)) for place in (number % columns, number // columns)
        )
        self.origins_m = np.column_stack([x, y, np.zeros(count)])

    def base_n(self, positions: FloatArray) -> FloatArray:
        """Return the base's reaction [N], shape [count, 3], by our law."""
        model = self.pad.model
        device, room = Device(model.device), model.gel.buffers(self.count)
        model.gel.recorded(
            device.array(np.ones(self.count), wp.int32),
            device.array(positions, wp.vec3d),
            room,
            gel=self._gel,
        ).launch()
        return np.asarray(on_host(room[0])[:, model.clamped].sum(axis=1))

    def strayed(self, tips_m: FloatArray) -> list[str]:
        """Say how far an indenter was from where it was sent, if that matters."""
        away_m = float(np.linalg.norm(tips_m - self.poses[-1, :, :3, 3], axis=1).max())
        if away_m < _AIM_M:
            return []
        return [f"an indenter ended {1e6 * away_m:.1f} um from where it was sent"]

    def judged(
        self, positions: FloatArray, contact_n: FloatArray | None, **taken: Any
    ) -> ScenePress:
        """Judge the last frame of every environment.

        The force is that of the first, the depth the one that it was sent to, and the balance the
        largest: base reaction against libuipc's contact force on the nodes [N], shape [count,
        node_count, 3], over the latter; not a number where libuipc does not say that.

        Args:
            taken: Times and iterations.
        """
        pad, base_n, balance = self.pad, self.base_n(positions), float("nan")
        if contact_n is not None:
            whole_n = contact_n.sum(axis=1)
            size_n = np.maximum(np.linalg.norm(whole_n, axis=1), np.finfo(float).tiny)
            balance = float((np.linalg.norm(base_n + whole_n, axis=1) / size_n).max())
        x, y, z = base_n[0]
        return ScenePress(
            edges=1.0 / pad.scene.refinement,
            promised=False,
            tet_count=len(pad.model.elements),
            unknown_count=pad.model.pattern.dof_count,
            force_n=(float(x), float(y), float(z)),
            moment_nm=None,
            depth_m=float(pad.goals[-1, 0]),
            stiffness_n_m=pad.stiffness_n_m,
            balance=balance,
            **taken,
        )


def peer_pad(scene: Scene) -> PeerPad:
    """Press a scene by our solver, and mesh its pad for libuipc.

    Raises:
        ConfigError: libuipc cannot do this scene.
    """
    _refuse(scene)
    path = path_for(scene, plan_effects(scene))
    points = [move(path) for move in moves(scene)]
    linear = replace(scene, effects=(*scene.effects, *_LINEAR_AND_WHOLE))
    model = build_model(linear, plan=plan_effects(linear))
    goals = goals_of(scene)
    goals[:, 0] = [point.depth_m for point in points]
    return PeerPad(
        scene=scene,
        model=model,
        body=triangles(scene.indenter),
        goals=goals,
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
    """Return an indenter that is no plane as libuipc is given it."""
    assert not isinstance(indenter, Plane)
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
