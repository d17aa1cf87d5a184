"""Stress where two layers meet: from below, from above, and the force that goes through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.mesh.elements import boundary_faces, shape_gradients
from sim.solve.model import Model
from tacauchy_rig.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StressOnSides:
    """t = sigma n on an interface, from below and from above; one in the exact solution."""

    below_pa: FloatArray  # sigma of the lower layer, shape [face_count, point_count, 3]
    above_pa: FloatArray  # sigma of the upper layer, same shape
    areas_m2: FloatArray  # deformed area of each point, shape [face_count, point_count]

    @property
    def jump_relative(self) -> float:
        """Norm of the traction's jump over the norm of its mean, both over the interface."""
        jump = ((self.above_pa - self.below_pa) ** 2).sum(axis=2)
        mean = ((0.5 * (self.above_pa + self.below_pa)) ** 2).sum(axis=2)
        size = float((mean * self.areas_m2).sum())
        return float(np.sqrt((jump * self.areas_m2).sum() / size)) if size > 0.0 else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceTraction:
    """One interface of a deformed gel.

    The elements' own stress is discontinuous. That of a stiff skin is worth little across it: the
    error scales with the skin's modulus, the traction with the soft gel's.
    """

    below: BoolArray  # which tetrahedra lie below it, shape [tet_count]
    faces: IntArray  # on it, shape [face_count, face_node_count]
    # Of the gel below on the gel above for the whole pad, +z in compression as the force on the
    # indenter is, shape [3]: the sum of the nodal forces, which equilibrium makes equal to the
    # base's force, but for the weight in between
    force_n: FloatArray
    element: StressOnSides  # by the stress of each element


def interface_traction(model: Model, positions: FloatArray) -> tuple[InterfaceTraction, ...]:
    """Return the traction on every interface from the base upwards; none in a gel of one layer."""
    labels, found = model.mesh.labels, []
    for below in (labels <= layer for layer in range(int(labels.max()))):
        faces, under, over = _shared_faces(model.elements, below)
        forces = nodal_forces(model, positions, below)[np.unique(faces)]
        sides = (_stress_on_faces(model, positions, faces, each) for each in (under, over))
        element = on_sides(model, positions, faces, *sides)
        whole_n = -model.mesh.symmetry.whole_force(forces.sum(axis=0))
        found.append(InterfaceTraction(below=below, faces=faces, force_n=whole_n, element=element))
    return tuple(found)


def on_sides(
    model: Model, positions: FloatArray, faces: IntArray, below_pa: FloatArray, above_pa: FloatArray
) -> StressOnSides:
    """Return the tractions of stresses at the points of faces, shape [f, p, 3, 3]."""
    vectors = model.reference.area_vectors(positions[faces])
    areas = np.linalg.norm(vectors, axis=2)
    normals = vectors / areas[..., None]
    lower, upper = (np.einsum("fpij,fpj->fpi", each, normals) for each in (below_pa, above_pa))
    return StressOnSides(below_pa=lower, above_pa=upper, areas_m2=areas)


def _shared_faces(elements: IntArray, below: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the faces between two sets of elements and the element on either side of each."""
    sides, stride = [], int(elements.max()) + 1
    for side in (below, ~below):
        chosen = np.flatnonzero(side).astype(np.int32)
        faces, parents = boundary_faces(elements[chosen])
        a, b, c = np.sort(faces[:, :3], axis=1).astype(np.int64).T
        sides.append((faces, chosen[parents], (a * stride + b) * stride + c))
    (faces, under, low), (_, over, high) = sides
    _, here, there = np.intersect1d(low, high, assume_unique=True, return_indices=True)
    return faces[here], under[here], over[there]


def _stress_on_faces(
    model: Model, positions: FloatArray, faces: IntArray, parents: IntArray
) -> FloatArray:
    """Return the stress of one side's elements at the faces' points, shape [f, p, 3, 3]."""
    nodes = model.elements[parents]
    points = model.reference.face_points
    barycentric = np.zeros((len(faces), len(points), 4))
    for corner in range(3):
        place = np.argmax(nodes[:, :4] == faces[:, corner, None], axis=1)
        barycentric[np.arange(len(faces)), :, place] = points[:, corner]
    gradients = shape_gradients(model.reference.order, barycentric)
    deformed = np.einsum("fnx,fpny->fpxy", positions[nodes], gradients)
    deformations = deformed @ model.discretisation.inverse_jacobians[parents, None]
    stress = model.gel.stress_at(deformations.reshape(-1, 3, 3), np.repeat(parents, len(points)))
    return stress.reshape(deformations.shape)


def nodal_forces(model: Model, positions: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the sum of some elements' nodal forces [N], shape [node_count, 3].

    An element's force on node n is the sum over its points of w sigma cof(dx/dxi) grad N_n.
    """
    nodes = model.elements[chosen]
    deformed = np.einsum("enx,qny->eqxy", positions[nodes], model.reference.gradients)
    inverse = np.swapaxes(np.linalg.inv(deformed), 2, 3)
    cofactors = np.linalg.det(deformed)[..., None, None] * inverse
    shares = model.reference.weights[:, None, None]
    weighted = model.gel.cauchy_stress(positions)[chosen] * shares / 6.0
    forces = np.einsum("eqik,qnk->eni", weighted @ cofactors, model.reference.gradients)
    total = np.zeros_like(positions)
    np.add.at(total, nodes, forces)
    return total
