"""Stress where two layers meet: from below, from above, and the force that goes through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.fields.stress_field import recovered_stress
from sim.mesh.elements import boundary_faces, shape_gradients
from sim.mesh.sparsity import assembled
from sim.mesh.symmetry import MirrorSymmetry
from sim.solve.model import Model


@dataclass(frozen=True, slots=True, kw_only=True)
class StressOnSides:
    """t = sigma n on an interface, from below and from above; one in the exact solution.

    Attributes:
        below_pa: sigma of the lower layer, shape [face_count, point_count, 3].
        above_pa: sigma of the upper layer, same shape.
        areas_m2: Deformed area of each point, shape [face_count, point_count].
        symmetry: By which the faces stand for the whole interface.
    """

    below_pa: FloatArray
    above_pa: FloatArray
    areas_m2: FloatArray
    symmetry: MirrorSymmetry

    @property
    def forces_n(self) -> tuple[FloatArray, FloatArray]:
        """Integrals of both over the whole interface, shape [3] each."""
        below, above = (
            -self.symmetry.whole_force(np.einsum("fpi,fp->i", side, self.areas_m2))
            for side in (self.below_pa, self.above_pa)
        )
        return below, above

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

    Forces are those of the gel below on the gel above for the whole pad, +z in compression, as the
    force on the indenter is.

    The elements' own stress is discontinuous. That of a stiff skin is worth little across it: the
    error scales with the skin's modulus, the traction with the soft gel's. The recovered traction
    has the nodal forces of either side as its virtual work, so it is one and balances the press.

    Attributes:
        nodes: Nodes of the interface, shape [node_count].
        recovered_pa: Recovered traction on the upper side of the lower layer, shape [node_count,
            3].
        recovered_above_pa: The same from the nodal forces of the layers above; equilibrium of the
            nodes makes the two equal, but for weight.
        force_n: Sum of the nodal forces, which equilibrium makes equal to the base's force, but for
            the weight in between, shape [3].
        element: By the stress of each element.
        smooth: By each layer's stress made continuous within it.
    """

    nodes: IntArray
    recovered_pa: FloatArray
    recovered_above_pa: FloatArray
    force_n: FloatArray
    element: StressOnSides
    smooth: StressOnSides

    @property
    def recovered_jump_relative(self) -> float:
        """Norm over the nodes of the recovered tractions' difference over that of the lower one."""
        size = float(np.linalg.norm(self.recovered_pa))
        jump = float(np.linalg.norm(self.recovered_above_pa - self.recovered_pa))
        return jump / size if size > 0.0 else 0.0


def interface_traction(model: Model, positions: FloatArray) -> tuple[InterfaceTraction, ...]:
    """Return the traction on every interface from the base upwards; none in a gel of one layer.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
    """
    labels = model.mesh.layers
    if labels is None:
        return ()
    return tuple(_traction(model, positions, labels, layer) for layer in range(int(labels.max())))


def _traction(
    model: Model, positions: FloatArray, labels: IntArray, layer: int
) -> InterfaceTraction:
    below = labels <= layer
    faces, under, over = _shared_faces(model.elements, below)
    reference = model.reference
    vectors = reference.area_vectors(positions[faces])
    areas = np.linalg.norm(vectors, axis=2)
    normals = vectors / areas[..., None]
    symmetry, nodes = model.mesh.symmetry, np.unique(faces)

    def on_sides(below_pa: FloatArray, above_pa: FloatArray) -> StressOnSides:
        lower, upper = (np.einsum("fpij,fpj->fpi", each, normals) for each in (below_pa, above_pa))
        return StressOnSides(below_pa=lower, above_pa=upper, areas_m2=areas, symmetry=symmetry)

    def smooth(side: NDArray[np.bool_]) -> FloatArray:
        stress = recovered_stress(model, positions, side)[faces[:, :3]]
        return np.asarray(np.einsum("pc,fcij->fpij", reference.face_points, stress))

    forces, forces_above = (
        _nodal_forces(model, positions, side)[nodes] for side in (below, ~below)
    )
    return InterfaceTraction(
        nodes=nodes,
        recovered_pa=_recovered(model, faces, areas, nodes, forces),
        recovered_above_pa=_recovered(model, faces, areas, nodes, -forces_above),
        force_n=-symmetry.whole_force(forces.sum(axis=0)),
        element=on_sides(
            _stress_on_faces(model, positions, faces, under),
            _stress_on_faces(model, positions, faces, over),
        ),
        smooth=on_sides(smooth(labels == layer), smooth(labels == layer + 1)),
    )


def _shared_faces(
    elements: IntArray, below: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the faces between two sets of elements and the element on either side of each."""
    sides = []
    for side in (below, ~below):
        chosen = np.flatnonzero(side).astype(np.int32)
        faces, parents = boundary_faces(elements[chosen])
        corners = np.sort(faces[:, :3], axis=1)
        order = np.lexsort(corners.T)
        sides.append((faces[order], chosen[parents[order]], corners[order]))
    (faces, under, low), (_, over, high) = sides
    stride = int(elements.max()) + 1
    keys = [(c[:, 0].astype(np.int64) * stride + c[:, 1]) * stride + c[:, 2] for c in (low, high)]
    _, here, there = np.intersect1d(keys[0], keys[1], assume_unique=True, return_indices=True)
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


def _nodal_forces(model: Model, positions: FloatArray, chosen: NDArray[np.bool_]) -> FloatArray:
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


def _recovered(
    model: Model, faces: IntArray, areas: FloatArray, nodes: IntArray, forces: FloatArray
) -> FloatArray:
    """Return the traction whose virtual work on the faces is that of nodal forces [Pa].

    On a mirror plane its components across the plane are zero.
    """
    values = model.reference.face_values
    local = np.searchsorted(nodes, faces)
    blocks = np.einsum("fp,pi,pj->fij", areas, values, values)
    mass = assembled(blocks, local, len(nodes)).tocsc()
    size = float(np.abs(model.mesh.vertices).max())
    held = model.mesh.symmetry.on_plane(model.nodes[nodes], size)
    traction = np.zeros_like(forces)
    for axis in range(3):
        free = np.flatnonzero(~held[:, axis])
        part = mass[free][:, free]
        traction[free, axis] = scipy.sparse.linalg.spsolve(part, forces[free, axis])
    return traction
