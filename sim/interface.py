"""Stress where two layers meet: from below, from above, and the force that goes through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.elements import boundary_faces, shape_gradients
from sim.model import Model


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceTraction:
    """One interface of a deformed gel, shape [face_count, point_count, ...] for the modelled part.

    Forces are those of the gel below on the gel above for the whole pad, +z in compression, as the
    force on the indenter is.

    Attributes:
        normals: Deformed unit normals, out of the lower layer.
        areas_m2: Deformed area of each point.
        below_pa: t = sigma n, sigma of the element below.
        above_pa: t = sigma n, sigma of the element above; the same in the exact solution.
        force_n: Sum of the nodal forces, which equilibrium makes equal to the base's force, shape
            [3].
        force_below_n: Integral of ``below_pa``, shape [3].
        force_above_n: Integral of ``above_pa``, shape [3].
    """

    normals: FloatArray
    areas_m2: FloatArray
    below_pa: FloatArray
    above_pa: FloatArray
    force_n: FloatArray
    force_below_n: FloatArray
    force_above_n: FloatArray

    @property
    def jump_relative(self) -> float:
        """Norm of the traction's jump over the norm of its mean, both over the interface."""
        jump = ((self.above_pa - self.below_pa) ** 2).sum(axis=2)
        mean = ((0.5 * (self.above_pa + self.below_pa)) ** 2).sum(axis=2)
        size = float((mean * self.areas_m2).sum())
        return float(np.sqrt((jump * self.areas_m2).sum() / size)) if size > 0.0 else 0.0


def interface_traction(model: Model, positions: FloatArray) -> tuple[InterfaceTraction, ...]:
    """Return the traction on every interface from the base upwards; none in a gel of one layer.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
    """
    labels = model.mesh.layers
    if labels is None:
        return ()
    return tuple(_traction(model, positions, labels <= layer) for layer in range(int(labels.max())))


def _traction(model: Model, positions: FloatArray, below: NDArray[np.bool_]) -> InterfaceTraction:
    faces, under, over = _shared_faces(model.elements, below)
    reference = model.reference
    along = np.einsum("pka,fkx->afpx", reference.face_gradients, positions[faces])
    vectors = 0.5 * np.cross(along[0], along[1]) * reference.face_weights[:, None]
    areas = np.linalg.norm(vectors, axis=2)
    normals = vectors / areas[..., None]
    lower, upper = (
        np.einsum("fpij,fpj->fpi", _stress_on_faces(model, positions, faces, parents), normals)
        for parents in (under, over)
    )
    fold = model.mesh.fold
    return InterfaceTraction(
        normals=normals,
        areas_m2=areas,
        below_pa=lower,
        above_pa=upper,
        force_n=-fold.whole_force(_nodal_force(model, positions, np.flatnonzero(below), faces)),
        force_below_n=-fold.whole_force(np.einsum("fpi,fp->i", lower, areas)),
        force_above_n=-fold.whole_force(np.einsum("fpi,fp->i", upper, areas)),
    )


def _shared_faces(
    elements: IntArray, below: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the faces between two sets of elements and the element on either side of each."""
    sides = []
    for chosen in (np.flatnonzero(below), np.flatnonzero(~below)):
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
    corners = model.nodes[nodes[:, :4]]
    jacobians = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    deformed = np.einsum("fnx,fpny->fpxy", positions[nodes], gradients)
    deformations = deformed @ np.linalg.inv(jacobians)[:, None]
    stress = model.stress_at(deformations.reshape(-1, 3, 3), np.repeat(parents, len(points)))
    return stress.reshape(deformations.shape)


def _nodal_force(
    model: Model, positions: FloatArray, elements: IntArray, faces: IntArray
) -> FloatArray:
    """Return the sum of some elements' nodal forces on the nodes of faces [N], shape [3].

    An element's force on node n is the sum over its points of w sigma cof(dx/dxi) grad N_n.
    """
    nodes = model.elements[elements]
    deformed = np.einsum("enx,qny->eqxy", positions[nodes], model.reference.gradients)
    cofactors = np.linalg.det(deformed)[..., None, None] * np.swapaxes(
        np.linalg.inv(deformed), 2, 3
    )
    stress = model.cauchy_stress(positions)[elements]
    weights = model.reference.weights / 6.0
    flux = np.einsum("q,eqij,eqjk->eqik", weights, stress, cofactors)
    forces = np.einsum("eqik,qnk->eni", flux, model.reference.gradients)
    return np.asarray(forces[np.isin(nodes, faces)].sum(axis=0))
