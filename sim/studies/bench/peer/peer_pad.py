"""A batch's scene as libuipc is given it, and what our own solver makes of its mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.contact.state import ContactOptions
from sim.material.laws.catalogue import law
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName
from sim.scene.scene import Scene
from sim.scene.tilted_indenter import cylinder_triangles
from sim.scene.triangle_surface import closed_surface
from sim.solve.load_steps.first_touch import touch_height
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from sim.studies.bench.batches import environments
from sim.studies.bench.frames import TRAVEL_M
from sim.studies.bench.peer.pad_mesh import PeerMesh, linear_mesh
from sim.studies.bench.peer.task import PeerTask
from sim.studies.bench.peer.tolerance import PeerTolerance
from tacauchy_rig.errors import ConfigError

_BODY_SECTORS = 64
_STEPS = 4
# Every node beneath the indenter carries its share of the force at a gap of 0.6 d_hat, where the
# barrier's force is this times kappa d_hat^3.
_BARRIER_FORCE = 2.93
_TOP_SHARE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerPad:
    """A scene as libuipc is given it.

    Attributes:
        scene: Its gel is of one material.
        whole: The batch's model of the pad, without symmetry.
        kind: Of the peer's mesh.
        model: Ours on the peer's mesh.
    """

    scene: Scene
    cylinder: Cylinder
    whole: Model
    kind: PeerMesh
    model: Model

    def task(self, *, count: int, tolerance: PeerTolerance, load_n: float) -> PeerTask:
        """Return the presses of the batch's first environments.

        Args:
            load_n: About the force at their end [N].
        """
        model, distance_m = self.model, self.whole.contact_options.distance_m
        triangles = cylinder_triangles(self.cylinder, sectors=_BODY_SECTORS)
        surface = closed_surface(*triangles, name="cylinder")
        chosen = environments(self.scene, count)
        beneath = np.hypot(*model.nodes[:, :2].T) < self.cylinder.radius_m
        beneath &= model.nodes[:, 2] > _TOP_SHARE * model.height_m
        return PeerTask(
            nodes=model.nodes,
            tets=model.elements,
            clamped=model.clamped,
            young_pa=np.array([environment.young_pa for environment in chosen]),
            poisson=self.scene.material.poisson,
            depths_m=np.stack([environment.course for environment in chosen], axis=1),
            body_vertices=surface.vertices,
            body_faces=surface.faces,
            touch_m=touch_height(
                self.whole,
                self.cylinder,
                self.whole.nodes,
                centre_m=(0.0, 0.0),
                rotation=np.eye(3),
            ),
            distance_m=distance_m,
            resistance=load_n / int(beneath.sum()) / (_BARRIER_FORCE * distance_m**3),
            tolerance=tolerance,
        )

    def our_force(self) -> float:
        """Return F_z at the end of the travel by our solver on the peer's mesh [N].

        Raises:
            ConvergenceError: The gel cannot be pressed that far.
        """
        path = LoadingPath(self.model, self.cylinder)
        points = [path.advance(TRAVEL_M * step / _STEPS) for step in range(1, _STEPS + 1)]
        return float(points[-1].force_n[2])


def peer_pad(scene: Scene, whole: Model, kind: PeerMesh) -> PeerPad:
    """Mesh a scene's pad for libuipc.

    Args:
        whole: The batch's model of the pad, without symmetry.

    Raises:
        ConfigError: The indenter is no cylinder.
    """
    if not isinstance(scene.indenter, Cylinder):
        raise ConfigError("libuipc is given cylinders only here", remedy="press a cylinder")
    return PeerPad(
        scene=scene,
        cylinder=scene.indenter,
        whole=whole,
        kind=kind,
        model=Model(
            linear_mesh(whole.mesh, kind),
            order=ElementOrder.P1,
            law=law(LawName.STABLE_NEO_HOOKEAN),
            young_pa=scene.material.young_pa,
            poisson=scene.material.poisson,
            contact_options=ContactOptions(distance_m=whole.contact_options.distance_m),
        ),
    )
