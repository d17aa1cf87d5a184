"""Signatures of pressing, sliding and torsion as numbers (paper, section IV-E)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.loading import PathPoint

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactTraction:
    """Contact forces on the gel, point by point, shape [face_count, point_count, ...].

    Attributes:
        arms_m: From the indenter's tip [m], shape [..., 3].
        normals: The indenter's outward unit normals, zero where nothing touches, shape [..., 3].
        normal_n: Normal force [N]; positive presses on the gel.
        tangential_n: Tangential force [N], shape [..., 3].
    """

    arms_m: FloatArray
    normals: FloatArray
    normal_n: FloatArray
    tangential_n: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSignature:
    """What the contact of one equilibrium looks like, seen along z; forces act on the gel.

    Attributes:
        normal_n: Sum of the normal forces' sizes [N].
        tangential_n: Sum of the tangential forces, as a vector [N], shape [3].
        tangential_sum_n: Sum of the tangential forces' sizes [N].
        centre_m: Centre of pressure relative to the indenter's axis, x and y [m].
        circumferential_share: Part of ``tangential_sum_n`` that runs around the axis.
        radial_share: Part of it that runs straight towards or away from the axis, along the
            indenter's surface.
        inward_share: Part of it that runs towards the axis less that away from it.
    """

    normal_n: float
    tangential_n: tuple[float, float, float]
    tangential_sum_n: float
    centre_m: tuple[float, float]
    circumferential_share: float
    radial_share: float
    inward_share: float

    @property
    def mobilised_friction(self) -> float:
        """Tangential resultant over normal force."""
        return float(np.linalg.norm(self.tangential_n)) / max(self.normal_n, 1e-300)

    @property
    def sliding_friction(self) -> float:
        """Sum of the tangential forces' sizes over normal force: mu where every point slides."""
        return self.tangential_sum_n / max(self.normal_n, 1e-300)


def contact_traction(point: PathPoint) -> ContactTraction:
    """Split the contact forces of an equilibrium along the indenter's normals."""
    contact = point.equilibrium.contact
    normals = _normals(point)
    forces = -contact.forces
    along = np.einsum("fpi,fpi->fp", forces, normals)
    return ContactTraction(
        arms_m=contact.points - point.state.tip,
        normals=normals,
        normal_n=np.abs(along),
        tangential_n=forces - along[..., None] * normals,
    )


def contact_signature(point: PathPoint) -> ContactSignature:
    """Measure the contact of an equilibrium of a whole, unfolded pad."""
    traction = contact_traction(point)
    arms, normals = traction.arms_m.reshape(-1, 3), traction.normals.reshape(-1, 3)
    tangential, pressed = traction.tangential_n.reshape(-1, 3), traction.normal_n.reshape(-1)
    around = _unit(np.cross(_UP, arms * (1.0, 1.0, 0.0)))
    outward = _unit(np.cross(around, normals))
    outward *= np.sign(np.einsum("pi,pi->p", outward, arms))[:, None]
    size = float(np.linalg.norm(tangential, axis=1).sum())
    centre = pressed @ arms / max(float(pressed.sum()), 1e-300)
    radial = np.einsum("pi,pi->p", tangential, outward)
    x, y, z = (float(value) for value in tangential.sum(axis=0))
    return ContactSignature(
        normal_n=float(pressed.sum()),
        tangential_n=(x, y, z),
        tangential_sum_n=size,
        centre_m=(float(centre[0]), float(centre[1])),
        circumferential_share=_along(tangential, around) / max(size, 1e-300),
        radial_share=float(np.abs(radial).sum()) / max(size, 1e-300),
        inward_share=-float(radial.sum()) / max(size, 1e-300),
    )


def _normals(point: PathPoint) -> FloatArray:
    """Return the indenter's outward normals as contact knows them, zero where nothing touches."""
    grip = point.state.grip
    loads = point.equilibrium.contact.forces
    if grip is not None:
        loads = np.asarray(grip.loads @ point.state.rotation.T)
    return _unit(loads)


def _unit(vectors: FloatArray) -> FloatArray:
    sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(sizes, 1e-300))


def _along(forces: FloatArray, directions: FloatArray) -> float:
    return float(np.abs(np.einsum("pi,pi->p", forces, directions)).sum())
