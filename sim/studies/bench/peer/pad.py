"""A batch's scene as libuipc is given it, and what the presses that come back are worth.

libuipc has linear tetrahedra only. The gel's law is the same in both engines, so the gel's forces
follow from the positions alone: at the clamped base they are the reaction; at every other node they
and those of contact should vanish together.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.batch.environment import Environment, course_of
from sim.contact.state import ContactOptions
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder, quadratic_nodes
from sim.mesh.tet_mesh import TetMesh, oriented
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName
from sim.scene.scene import Scene
from sim.scene.tilted_indenter import cylinder_triangles
from sim.scene.triangle_surface import closed_surface
from sim.solve.load_steps.first_touch import touch_height
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from sim.studies.bench.batches import spread
from sim.studies.bench.frames import FRAME_COUNT, TRAVEL_M
from sim.studies.bench.peer.task import PeerFound, PeerTask, PeerTolerance
from tacauchy_rig.errors import ConfigError

# The parts of a quadratic tetrahedron: four at its corners, four around the line from the middle of
# edge 02 to that of edge 13. Node order is that of sim/mesh/elements.py.
_PARTS = (
    (0, 4, 6, 7),
    (1, 5, 4, 8),
    (2, 6, 5, 9),
    (3, 7, 9, 8),
    (6, 8, 4, 5),
    (6, 8, 5, 9),
    (6, 8, 9, 7),
    (6, 8, 7, 4),
)
_BODY_SECTORS = 64
_STEPS = 4
# Every node beneath the indenter carries its share of the force at a gap of 0.6 d_hat, where the
# barrier's force is this times kappa d_hat^3.
_BARRIER_FORCE = 2.93
_TOP_SHARE = 0.9


class PeerMesh(StrEnum):
    """Which of our mesh's points the peer's linear tetrahedra stand on."""

    CORNERS = "same tetrahedra, linear"
    NODES = "same nodes, linear"


def linear_mesh(whole: TetMesh, kind: PeerMesh) -> TetMesh:
    """Return linear tetrahedra on the corners, or on all nodes, of a pad's quadratic ones.

    Args:
        whole: The pad without symmetry.
    """
    if kind is PeerMesh.CORNERS:
        return whole
    nodes, elements = quadratic_nodes(whole.vertices, whole.tets)
    parts: IntArray = np.concatenate([elements[:, list(part)] for part in _PARTS])
    name = f"{whole.name}, each tetrahedron in eight"
    return oriented(TetMesh(vertices=nodes, tets=parts, name=name))


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
        course = course_of(self.scene, frame_count=FRAME_COUNT)
        chosen = spread(self.scene, course, count)
        beneath = np.hypot(*model.nodes[:, :2].T) < self.cylinder.radius_m
        beneath &= model.nodes[:, 2] > _TOP_SHARE * model.height_m
        return PeerTask(
            nodes=model.nodes,
            tets=model.elements,
            clamped=model.clamped,
            young_pa=np.array([_young_pa(each) for each, _ in chosen]),
            poisson=self.scene.material.poisson,
            depths_m=np.stack([each.along for _, each in chosen], axis=1),
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerBalance:
    """Forces of the last frame.

    Attributes:
        force_n: F_z of the first environment: reaction of the base [N].
        imbalance: Base reaction against libuipc's contact force, over the latter, the largest; not
            a number where libuipc does not say its contact force.
        residual: Norm of the unbalanced force over the contact force, the largest; likewise.
        inner_residual: The same over the nodes that contact does not push: it tells what the
            engines' laws and iterations differ by from what contact makes of it.
        gap_m: The smallest height of the indenter's underside above a node of the gel [m].
        depth_error_m: By how much the indenter went too deep, the largest of either sign [m].
    """

    force_n: float
    imbalance: float
    residual: float
    inner_residual: float
    gap_m: float
    depth_error_m: float


def _young_pa(environment: Environment) -> float:
    """Return E of an environment's one material [Pa]."""
    (material,) = environment.materials or ()
    return material.young_pa


def peer_balance(pad: PeerPad, task: PeerTask, found: PeerFound) -> PeerBalance:
    """Judge the last frame of every environment.

    Args:
        task: Of the pad; its first environment has the pad's own gel.
    """
    model = pad.model
    forces, imbalances, residuals, inner_residuals, gaps = [], [], [], [], []
    for number, positions in enumerate(found.positions):
        stiffer = task.young_pa[number] / task.young_pa[0]
        elastic = stiffer * model.gel.gradient(positions)
        base_n = float(elastic[task.clamped, 2].sum())
        forces.append(base_n)
        gaps.append(_gap(pad, positions, float(found.tips_m[number])))
        if found.contact_n is not None:
            contact = found.contact_n[number]
            pushed_n = max(float(np.linalg.norm(contact.sum(axis=0))), 1e-300)
            imbalances.append(abs(base_n + float(contact[:, 2].sum())) / pushed_n)
            unbalanced = (elastic - contact)[~task.clamped]
            residuals.append(float(np.linalg.norm(unbalanced)) / pushed_n)
            inside = ~contact[~task.clamped].any(axis=1)
            inner_residuals.append(float(np.linalg.norm(unbalanced[inside])) / pushed_n)
    wrong_m = task.touch_m - task.depths_m[-1] - found.tips_m
    return PeerBalance(
        force_n=forces[0],
        imbalance=max(imbalances, default=float("nan")),
        residual=max(residuals, default=float("nan")),
        inner_residual=max(inner_residuals, default=float("nan")),
        gap_m=min(gaps),
        depth_error_m=float(wrong_m[np.argmax(np.abs(wrong_m))]),
    )


def _gap(pad: PeerPad, positions: FloatArray, tip_m: float) -> float:
    surface = positions[np.unique(pad.model.faces)]
    above = tip_m + pad.cylinder.lower_surface(surface[:, 0], surface[:, 1]) - surface[:, 2]
    return float(above.min())
