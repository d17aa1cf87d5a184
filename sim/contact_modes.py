"""Signatures of pressing, sliding and torsion as numbers (paper, section IV-E)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.loading import PathPoint


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSignature:
    """What the contact of one equilibrium looks like, seen along z; forces act on the gel.

    Attributes:
        normal_n: Sum of the normal forces' sizes [N].
        tangential_n: Sum of the tangential forces, as a vector [N], shape [3].
        tangential_sum_n: Sum of the tangential forces' sizes [N].
        centre_m: Centre of pressure relative to the indenter's axis, x and y [m].
        circumferential_share: Part of ``tangential_sum_n`` that runs around the axis.
        radial_share: Part of it that runs towards or away from the axis.
    """

    normal_n: float
    tangential_n: tuple[float, float, float]
    tangential_sum_n: float
    centre_m: tuple[float, float]
    circumferential_share: float
    radial_share: float

    @property
    def mobilised_friction(self) -> float:
        """Tangential resultant over normal force."""
        return float(np.linalg.norm(self.tangential_n)) / max(self.normal_n, 1e-300)


def contact_signature(point: PathPoint) -> ContactSignature:
    """Measure the contact of an equilibrium of a whole, unfolded pad."""
    contact = point.equilibrium.contact
    normals = _normals(point)
    forces = -contact.forces.reshape(-1, 3)
    normal = np.einsum("pi,pi->p", forces, normals)
    tangential = forces - normal[:, None] * normals
    arms = (contact.points.reshape(-1, 3) - point.state.tip)[:, :2]
    outward = arms / np.maximum(np.linalg.norm(arms, axis=1, keepdims=True), 1e-30)
    around = np.column_stack([-outward[:, 1], outward[:, 0]])
    size = float(np.linalg.norm(tangential, axis=1).sum())
    pressed = np.abs(normal)
    centre = pressed @ arms / max(float(pressed.sum()), 1e-300)
    x, y, z = (float(value) for value in tangential.sum(axis=0))
    return ContactSignature(
        normal_n=float(pressed.sum()),
        tangential_n=(x, y, z),
        tangential_sum_n=size,
        centre_m=(float(centre[0]), float(centre[1])),
        circumferential_share=_along(tangential, around) / max(size, 1e-300),
        radial_share=_along(tangential, outward) / max(size, 1e-300),
    )


def _normals(point: PathPoint) -> FloatArray:
    """Return the indenter's outward normals as contact knows them, zero where nothing touches."""
    grip = point.state.grip
    if grip is None:
        loads = point.equilibrium.contact.forces.reshape(-1, 3)
    else:
        loads = (grip.loads @ point.state.rotation.T).reshape(-1, 3)
    sizes = np.linalg.norm(loads, axis=1, keepdims=True)
    return np.asarray(loads / np.maximum(sizes, 1e-300))


def _along(forces: FloatArray, directions: FloatArray) -> float:
    return float(np.abs(np.einsum("pi,pi->p", forces[:, :2], directions)).sum())
