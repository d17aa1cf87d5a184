"""Cauchy stress on the gel's surface, contact forces on its nodes (paper, Algorithms 1, 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.model import Model


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceStress:
    """Algorithm 1 on every face that is not clamped, shape [face_count, ...].

    Attributes:
        normals: Outward unit normals of the deformed faces.
        areas_m2: Deformed areas.
        traction_pa: t = sigma n, sigma of the parent tetrahedron (mean over its points).
        normal_pa: p_n = t . n; negative is compression.
        tangential_pa: t - p_n n.
    """

    normals: FloatArray
    areas_m2: FloatArray
    traction_pa: FloatArray
    normal_pa: FloatArray
    tangential_pa: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class NodalContact:
    """Algorithm 2 on every node, shape [node_count, ...]; zero away from contact.

    The nodal forces of quadratic faces are the virtual work's: a corner's share of an even
    pressure is small. ``pressure_pa`` is therefore the nodal average of the pointwise pressure.

    Attributes:
        force_n: Contact force on the gel.
        normal_n: Its part along the gel's outward normal.
        tangential_n: The rest.
        pressure_pa: Contact pressure on the deformed surface.
    """

    force_n: FloatArray
    normal_n: FloatArray
    tangential_n: FloatArray
    pressure_pa: FloatArray


def element_stress(model: Model, positions: FloatArray) -> FloatArray:
    """Return sigma = P F^T / J (paper, Eq. 3) averaged over each element's points [Pa].

    Returns:
        Shape [element_count, 3, 3].
    """
    stress = model.gel.cauchy_stress(positions)
    return np.asarray(np.einsum("eqij,q->eij", stress, model.reference.weights))


def surface_stress(model: Model, positions: FloatArray) -> SurfaceStress:
    """Project the elements' stress onto the surface (paper, Algorithm 1, Eq. 5-7)."""
    vectors = model.surface.area_vectors(positions).sum(axis=1)
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / areas[:, None]
    stress = element_stress(model, positions)[model.face_parents]
    traction = np.einsum("fij,fj->fi", stress, normals)
    normal = np.einsum("fi,fi->f", traction, normals)
    return SurfaceStress(
        normals=normals,
        areas_m2=areas,
        traction_pa=traction,
        normal_pa=normal,
        tangential_pa=traction - normal[:, None] * normals,
    )


def nodal_contact(model: Model, point: PathPoint) -> NodalContact:
    """Split the contact forces at the nodes (paper, Algorithm 2)."""
    forces = -model.surface.scatter(point.equilibrium.contact.forces)
    vectors = model.surface.area_vectors(point.state.positions)
    areas = np.linalg.norm(vectors, axis=2)
    outward = model.surface.scatter(vectors / areas[..., None] * model.surface.areas[..., None])
    lengths = np.linalg.norm(outward, axis=1, keepdims=True)
    normals = np.divide(outward, lengths, out=np.zeros_like(outward), where=lengths > 0.0)
    normal = np.einsum("ni,ni->n", forces, normals)[:, None] * normals
    return NodalContact(
        force_n=forces,
        normal_n=normal,
        tangential_n=forces - normal,
        pressure_pa=_nodal_pressure(model, point, areas),
    )


def _nodal_pressure(model: Model, point: PathPoint, areas: FloatArray) -> FloatArray:
    pressure = np.linalg.norm(point.equilibrium.contact.forces, axis=2) / areas
    share = np.abs(model.reference.face_values)
    weight, total = np.zeros(len(model.nodes)), np.zeros(len(model.nodes))
    for k in range(model.faces.shape[1]):
        np.add.at(weight, model.faces[:, k], (areas * share[:, k]).sum(axis=1))
        np.add.at(total, model.faces[:, k], (areas * share[:, k] * pressure).sum(axis=1))
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 0.0)
