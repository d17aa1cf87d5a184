"""What a tip that is tilted a little does to the pressed gel: first order in the tilt.

About the axisymmetric equilibrium every field goes with the cosine or the sine of the angle from
the direction of the tilt, so that one linear system in the half-plane tells all of it:
u = (a cos, (s - a) sin, c cos) along r, the angle and z, with s = c = 0 on the axis. What slips
keeps its friction; what sticks turns with the tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from drivers.emulators.plant.axisymmetric import (
    PENALTY_PER_M,
    STICK_PER_M,
    Equilibrium,
    GelSolver,
    assembled,
    dof_pairs,
)
from drivers.emulators.plant.quad_mesh import QuadMesh
from drivers.emulators.plant.tips import Tip
from tacauchy_rig.core.arrays import FloatArray, Int64Array

# Rows of the gradient: those of the (r, z) half-plane and the hoop, then those across it.
_PLANE, _ACROSS = 5, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltResponse:
    """The response to a tilt of one radian.

    Attributes:
        displacement: Along r and z on the side that the tip tilts to [m], [node_count, 2].
        moment: On the tip about its lowest point, over Young's modulus, against the tilt [m^3].
        side_force: On the tip towards the side that it tilts to, over Young's modulus [m^2]; small
            beside F_z and known to its half only, since the rim's contact decides on it.
    """

    displacement: FloatArray
    moment: float
    side_force: float


def tilt_response(
    solver: GelSolver, pressed: Equilibrium, tip: Tip, tip_z_m: float
) -> TiltResponse:
    """Return how a press answers a tilt of its tip.

    Args:
        solver: What pressed last, with this tip at this height.
        pressed: What it found.
    """
    mesh, count = solver.mesh, 3 * len(solver.mesh.nodes)
    u = pressed.displacement.ravel()
    contact = _Contact(solver, tip, u, tip_z_m)
    gel_dofs = _dofs(mesh.elements)
    gel, face = _gel_stiffness(solver, u), contact.stiffness()
    rows = np.concatenate([dof_pairs(gel_dofs, 0), dof_pairs(contact.dofs, 0)])
    columns = np.concatenate([dof_pairs(gel_dofs, 1), dof_pairs(contact.dofs, 1)])
    values = np.concatenate([gel.ravel(), face.ravel()])
    whole = coo_matrix((values, (rows, columns)), shape=(count, count)).tocsc()
    held = np.concatenate(
        [_dofs(mesh.base_nodes[:, None]).ravel(), 3 * mesh.axis_nodes + 1, 3 * mesh.axis_nodes + 2]
    )
    free = np.setdiff1d(np.arange(count), held)
    found = np.zeros(count)
    found[free] = splu(whole[free][:, free]).solve(contact.load(count)[free])
    moment, side_force = contact.answer(found)
    return TiltResponse(
        displacement=found.reshape(-1, 3)[:, [0, 2]], moment=moment, side_force=side_force
    )


def _gel_stiffness(solver: GelSolver, u: FloatArray) -> FloatArray:
    """Return the elements' stiffness, [element_count, 27, 27]."""
    operator, gradient = _mode_operator(solver.mesh), solver.deformation(u)
    tangent = np.zeros((*gradient.shape[:2], _PLANE + _ACROSS, _PLANE + _ACROSS))
    tangent[..., :_PLANE, :_PLANE] = solver.law.tangent(gradient)
    tangent[..., _PLANE:, _PLANE:] = solver.law.turning_tangent(gradient)
    # The mean of a squared cosine around the axis is a half.
    weighted = np.matmul(tangent * (0.5 * solver.weights)[..., None, None], operator)
    flat = operator.reshape(len(operator), -1, operator.shape[-1])
    stiffness: FloatArray = np.matmul(np.swapaxes(flat, 1, 2), weighted.reshape(flat.shape))
    return stiffness


def _mode_operator(mesh: QuadMesh) -> FloatArray:
    """Return d(gradient's rows)/d(a, s, c of the nodes) [1/m], [element, point, 9, 27]."""
    value, derivative, radius, _ = mesh.at_quadrature()
    operator = np.zeros((*radius.shape, _PLANE + _ACROSS, 9, 3))
    along_r, along_z = derivative[..., 0, :], derivative[..., 1, :]
    around = value / radius[..., None]
    a, s, c = range(3)
    operator[:, :, 0, :, a] = operator[:, :, 2, :, c] = along_r
    operator[:, :, 1, :, a] = operator[:, :, 3, :, c] = along_z
    operator[:, :, 4, :, s] = around
    operator[:, :, 5, :, s] = operator[:, :, 8, :, c] = -around
    operator[:, :, 6, :, s], operator[:, :, 6, :, a] = along_r, -along_r
    operator[:, :, 7, :, s], operator[:, :, 7, :, a] = along_z, -along_z
    return operator.reshape(*operator.shape[:3], 27)


class _Contact:
    """The springs between surface and tip, turned about the tip's lowest point."""

    def __init__(self, solver: GelSolver, tip: Tip, u: FloatArray, tip_z: float) -> None:
        self.dofs = _dofs(solver.mesh.top_edges)
        self._shape, self._weights = solver.edge_shape, solver.edge_weights
        r, z = solver.surface_points(u, tip_z)
        distance = tip.distance(r, z)
        inside = np.minimum(distance.value, 0.0)
        touching = (inside < 0.0).astype(np.float64)
        springs = np.zeros((len(r), 3, 3))
        plane = distance.gradient[:, :, None] * distance.gradient[:, None, :]
        plane += inside[:, None, None] * distance.hessian
        springs[:, ::2, ::2] = touching[:, None, None] * PENALTY_PER_M * plane
        springs[:, 1, 1] = PENALTY_PER_M * inside * distance.gradient[:, 0] / r
        self._pull = PENALTY_PER_M * inside[:, None] * distance.gradient
        if solver.springs is not None:
            points = np.stack([r, z], axis=-1)
            gripping, stiffness = solver.springs.linearised(points)
            springs[:, ::2, ::2] += touching[:, None, None] * stiffness
            springs[:, 1, 1] += touching * STICK_PER_M * solver.springs.sticks(points)
            self._pull = self._pull + touching[:, None] * gripping
        shape = self._weights.shape
        self._springs = springs.reshape(*shape, 3, 3)
        self._r, self._z = r.reshape(shape), z.reshape(shape)
        # How the tip's own points move, along r, the angle and z.
        self._turned = np.stack([self._z, -self._z, -self._r], axis=-1)
        # What presses on the tip turns with it, likewise.
        along, up = np.moveaxis(self._pull.reshape(*shape, 2), -1, 0)
        self._force_turned = np.stack([up, -up, -along], axis=-1)
        # From (a, s, c) to motion along r, the angle and z.
        self._basis = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    def stiffness(self) -> FloatArray:
        """Return the edges' stiffness, [edge_count, 9, 9]."""
        seen = np.einsum("xa,eqxy,yb->eqab", self._basis, self._springs, self._basis)
        shape = self._shape
        blocks = np.einsum("eq,qi,qj,eqab->eiajb", 0.5 * self._weights, shape, shape, seen)
        return np.asarray(blocks.reshape(len(blocks), 9, 9))

    def load(self, count: int) -> FloatArray:
        """Return what the tip's turning does to the nodes, shape [count]."""
        pushed = np.einsum("eqxy,eqy->eqx", self._springs, self._turned) - self._force_turned
        pushed = pushed @ self._basis
        local = np.einsum("eq,qi,eqa->eia", 0.5 * self._weights, self._shape, pushed)
        return assembled(self.dofs, local, count)

    def answer(self, found: FloatArray) -> tuple[float, float]:
        """Return moment and side force on the tip, of the surface's motion."""
        moved = np.einsum("qi,eia->eqa", self._shape, found[self.dofs].reshape(-1, 3, 3))
        moved = moved @ self._basis.T
        r, angle, z = range(3)
        felt = np.einsum("eqxy,eqy->eqx", self._springs, moved - self._turned)
        felt = felt + self._force_turned
        pull = self._pull.reshape(*self._weights.shape, 2)
        side = 0.5 * (felt[..., r] - felt[..., angle])
        over = 0.5 * (moved[..., r] - moved[..., angle])
        about = self._z * side - 0.5 * self._r * felt[..., z]
        about += 0.5 * moved[..., z] * pull[..., 0] - over * pull[..., 1]
        return -float(np.sum(self._weights * about)), float(np.sum(self._weights * side))


def _dofs(nodes: Int64Array) -> Int64Array:
    return (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
