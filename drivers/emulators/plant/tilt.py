"""What a tip that is tilted a little does to the pressed gel: first order in the tilt.

About the axisymmetric equilibrium every field goes with the cosine or the sine of the angle from
the direction of the tilt, so that one linear system in the half-plane tells all of it:
u = (a cos, (s - a) sin, c cos) along r, the angle and z, with s = c = 0 on the axis. What slips
keeps its friction; what sticks turns with the tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.axisymmetric import (
    PENALTY_PER_M,
    STICK_PER_M,
    Equilibrium,
    GelSolver,
    assembled,
    assembled_matrix,
    dofs_of,
    solved,
)
from drivers.emulators.plant.quad_mesh import QuadMesh
from tacauchy_rig.core.arrays import FloatArray

_MOTION = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""From (a, s, c) to motion along r, the angle and z."""


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
    moment: float = 0.0
    side_force: float = 0.0


def tilt_response(solver: GelSolver, pressed: Equilibrium) -> TiltResponse:
    """Return how a press answers a tilt of its tip.

    Args:
        solver: What pressed last.
        pressed: What it found.
    """
    mesh, u = solver.mesh, pressed.displacement.ravel()
    count, shape, weights = 3 * len(mesh.nodes), solver.edge_shape, 0.5 * solver.edge_weights
    gel_dofs, edge_dofs = dofs_of(mesh.elements, 3), dofs_of(mesh.top_edges, 3)
    points, pull, springs = _surface_springs(solver, u)
    r, z = np.moveaxis(points, -1, 0)
    # How the tip's own points move along r, the angle and z, and how what presses on it turns.
    turned = np.stack([z, -z, -r], axis=-1)
    force_turned = np.stack([pull[..., 1], -pull[..., 1], -pull[..., 0]], axis=-1)
    block = np.einsum("xa,eqxy,yb->eqab", _MOTION, springs, _MOTION)
    edges = np.einsum("eq,qi,qj,eqab->eiajb", weights, shape, shape, block)
    pushed = (np.einsum("eqxy,eqy->eqx", springs, turned) - force_turned) @ _MOTION
    load = assembled(edge_dofs, np.einsum("eq,qi,eqa->eia", weights, shape, pushed), count)
    stiffness = ((gel_dofs, _gel_stiffness(solver, u)), (edge_dofs, edges))
    held = np.concatenate(
        [dofs_of(mesh.base_nodes[:, None], 3).ravel(), *(3 * mesh.axis_nodes + i for i in (1, 2))]
    )
    free = np.setdiff1d(np.arange(count), held)
    found = solved(assembled_matrix(stiffness, count), load, free)
    moved = np.einsum("qi,eia->eqa", shape, found[edge_dofs].reshape(-1, 3, 3)) @ _MOTION.T
    felt = np.einsum("eqxy,eqy->eqx", springs, moved - turned) + force_turned
    side, over = felt[..., 0] - felt[..., 1], moved[..., 0] - moved[..., 1]
    about = z * side - r * felt[..., 2] + moved[..., 2] * pull[..., 0] - over * pull[..., 1]
    return TiltResponse(
        displacement=found.reshape(-1, 3)[:, [0, 2]],
        moment=-float(np.sum(weights * about)),
        side_force=float(np.sum(weights * side)),
    )


def _gel_stiffness(solver: GelSolver, u: FloatArray) -> FloatArray:
    """Return the elements' stiffness, [element_count, 27, 27]."""
    operator = _mode_operator(solver.mesh)
    _, tangent = solver.law.linearised(solver.deformation(u))
    # The mean of a squared cosine around the axis is a half.
    weighted = np.matmul(tangent * (0.5 * solver.weights)[..., None, None], operator)
    flat = operator.reshape(len(operator), -1, operator.shape[-1])
    return np.matmul(np.swapaxes(flat, 1, 2), weighted.reshape(flat.shape))


def _mode_operator(mesh: QuadMesh) -> FloatArray:
    """Return d(gradient)/d(a, s, c of the nodes) [1/m], [element, point, 9, 27]."""
    value, derivative, radius, _ = mesh.at_quadrature()
    operator = np.zeros((*radius.shape, 9, 9, 3))
    along_r, along_z = derivative[..., 0, :], derivative[..., 1, :]
    around = value / radius[..., None]
    a, s, c = range(3)
    operator[:, :, 0, :, a] = operator[:, :, 6, :, c] = along_r
    operator[:, :, 2, :, a] = operator[:, :, 8, :, c] = along_z
    operator[:, :, 4, :, s] = around
    operator[:, :, 1, :, s] = operator[:, :, 7, :, c] = -around
    operator[:, :, 3, :, s], operator[:, :, 3, :, a] = along_r, -along_r
    operator[:, :, 5, :, s], operator[:, :, 5, :, a] = along_z, -along_z
    return operator.reshape(*operator.shape[:3], 27)


def _surface_springs(solver: GelSolver, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (r, z) of the surface's points from the tip, what pulls there, and the springs.

    The shapes are [edge, point, 2] twice and [edge, point, 3, 3].
    """
    points, distance, depth = solver.contact(u)
    touching = (depth < 0.0).astype(np.float64)
    springs = np.zeros((len(points), 3, 3))
    plane = distance.gradient[:, :, None] * distance.gradient[:, None, :]
    plane += depth[:, None, None] * distance.hessian
    springs[:, ::2, ::2] = touching[:, None, None] * PENALTY_PER_M * plane
    springs[:, 1, 1] = PENALTY_PER_M * depth * distance.gradient[:, 0] / points[:, 0]
    pull = PENALTY_PER_M * depth[:, None] * distance.gradient
    if solver.springs is not None:
        gripping, stiffness = solver.springs.linearised(points)
        springs[:, ::2, ::2] += touching[:, None, None] * stiffness
        springs[:, 1, 1] += touching * STICK_PER_M * solver.springs.sticks(points)
        pull = pull + touching[:, None] * gripping
    shape = solver.edge_weights.shape
    return points.reshape(*shape, 2), pull.reshape(*shape, 2), springs.reshape(*shape, 3, 3)
