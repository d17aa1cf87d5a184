"""Finite-strain equilibrium of a disc of gel under a rigid tip of revolution.

Nine-node quadrilaterals, full integration; unilateral contact by a stiff penalty on the distance to
the tip, with Coulomb friction by springs that slip; clamped base, free wall. Young's
modulus of the layer that is touched is one, so forces come out in square metres and scale with the
true modulus.

A deformation gradient is nine numbers, row by row in the order r, angle, z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from drivers.emulators.plant.quad_mesh import QuadMesh
from drivers.emulators.plant.truth import Tip, TipDistance
from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import ConvergenceError

PENALTY_PER_M = 2e6  # times Young's modulus: the tip sinks in by p/E * 0.5 um
_ITERATION_LIMIT = 60
_BACKTRACK_LIMIT = 14
_SUFFICIENT = 0.1  # share of the decrease that a linear model promises
_STEP_TOLERANCE_M = 1e-10
_GRIP_LIMIT, _GRIP_TOLERANCE = 12, 2e-4  # rounds of friction, and their change over the pressure

_PERMUTED = np.zeros((3, 3, 3))
_PERMUTED[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_PERMUTED[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0
# The cofactor's derivative by the gradient is linear in the gradient.
_MINORS = np.einsum("ikm,jln->mnijkl", _PERMUTED, _PERMUTED).reshape(9, 81)


@dataclass(frozen=True, slots=True, kw_only=True)
class NeoHookean:
    """Compressible neo-Hookean law with split energy; Young's modulus is one.

    psi = mu/2 (J^(-2/3) Ic - 3) + K/2 (J - 1)^2 (Bonet and Wood 2008, section 6.5). Not the
    replay's law: the two share their small-strain limit and nothing else.
    """

    poisson: float

    @property
    def shear(self) -> float:
        """Shear modulus, as a multiple of Young's modulus."""
        return 0.5 / (1.0 + self.poisson)

    @property
    def bulk(self) -> float:
        """Bulk modulus, as a multiple of Young's modulus."""
        return 1.0 / (3.0 * (1.0 - 2.0 * self.poisson))

    def energy(self, gradient: FloatArray) -> FloatArray:
        """Return the energy density, shape [...]; inf where the element is turned inside out."""
        jacobian = np.linalg.det(gradient.reshape(*gradient.shape[:-1], 3, 3))
        j = np.where(jacobian > 0.0, jacobian, 1.0)
        ic = np.sum(gradient**2, axis=-1)
        energy = 0.5 * self.shear * (j ** (-2 / 3) * ic - 3.0) + 0.5 * self.bulk * (j - 1.0) ** 2
        return np.where(jacobian > 0.0, energy, np.inf)

    def linearised(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the first Piola-Kirchhoff stress [..., 9] and its derivative [..., 9, 9]."""
        minors = (gradient @ _MINORS).reshape(*gradient.shape, 9)
        cofactor = 0.5 * np.matmul(minors, gradient[..., None])[..., 0]
        j = (np.sum(gradient * cofactor, axis=-1) / 3.0)[..., None]
        ic = np.sum(gradient**2, axis=-1, keepdims=True)
        pressure = -self.shear / 3.0 * j ** (-5 / 3) * ic + self.bulk * (j - 1.0)
        stress = self.shear * j ** (-2 / 3) * gradient + pressure * cofactor
        across = -2 / 3 * self.shear * j ** (-5 / 3) * gradient
        across += (5 / 18 * self.shear * j ** (-8 / 3) * ic + 0.5 * self.bulk) * cofactor
        mixed = across[..., :, None] * cofactor[..., None, :]
        tangent = mixed + np.swapaxes(mixed, -1, -2)
        tangent += pressure[..., None] * minors
        tangent[..., range(9), range(9)] += self.shear * j ** (-2 / 3)
        return stress, tangent


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """One solution."""

    displacement: FloatArray  # (u_r, u_z) [m], shape [node_count, 2]
    force: float = 0.0  # force on the tip along the axis, over Young's modulus [m^2]
    contact_radius_m: float = 0.0  # largest deformed radius in contact [m]; 0 out of contact
    grip: Grip | None = None  # how far the springs of friction are drawn; None without friction


class GelSolver:
    """Presses one tip into one mesh; each call starts from the state it is given.

    Attributes:
        weights: 2 pi r dA times stiffness at the quadrature points [m^3], [element, point].
        edge_shape, edge_weights: Shape values of the surface's quadrature points, and 2 pi r ds at
            rest [m^2], [edge, point].
        springs: Of friction, as the last press left them; None without.
    """

    def __init__(self, mesh: QuadMesh, tip: Tip, *, poisson: float, friction: float = 0.0) -> None:
        self.mesh, self.tip, self.law = mesh, tip, NeoHookean(poisson=poisson)
        self._friction = friction
        self._tip_z_m = 0.0
        self.springs: Springs | None = None
        self._operator = gradient_operator(mesh, _ALONG, _AROUND)
        _, _, radius, area = mesh.at_quadrature()
        self.weights = 2.0 * np.pi * radius * area * mesh.stiffness[:, None]
        self._dofs, self._edge_dofs = dofs_of(mesh.elements, 2), dofs_of(mesh.top_edges, 2)
        self.edge_shape, self.edge_weights = mesh.at_surface_quadrature()
        self._clamped = np.union1d(dofs_of(mesh.base_nodes[:, None], 2), 2 * mesh.axis_nodes)

    def press(self, tip_z_m: float, start: FloatArray, *, grip: Grip | None = None) -> Equilibrium:
        """Return the equilibrium with the tip's lowest point at ``tip_z_m`` [m] above the base."""
        self._tip_z_m, self.springs, u = tip_z_m, None, start.ravel()
        if self._friction == 0.0 or grip is None:
            u = self._newton(u, self._clamped)
        if self._friction > 0.0:
            u, grip = self._gripped(u, grip)
        points, _, depth = self.contact(u)
        return Equilibrium(
            displacement=u.reshape(-1, 2),
            force=self._force(u),
            contact_radius_m=float(np.max(points[depth < 0.0, 0], initial=0.0)),
            grip=grip,
        )

    def contact(self, u: FloatArray) -> tuple[FloatArray, TipDistance, FloatArray]:
        """Return the surface's quadrature points from the tip [m], and how they touch it.

        Returns:
            (r, z) of the points, [point_count, 2]; their distance from the tip; the distance of
            those inside, else zero [m].
        """
        position = (self.mesh.nodes + u.reshape(-1, 2))[self.mesh.top_edges]
        points = np.einsum("qi,eia->eqa", self.edge_shape, position).reshape(-1, 2)
        points = points - [0.0, self._tip_z_m]
        distance = self.tip.distance(*points.T)
        return points, distance, np.minimum(distance.value, 0.0)

    def _force(self, u: FloatArray) -> float:
        """Return the tip's force along the axis, friction's too, over Young's modulus [m^2]."""
        points, distance, depth = self.contact(u)
        pull = PENALTY_PER_M * depth * distance.gradient[:, 1]
        if self.springs is not None:
            pull = pull + self.springs.linearised(points)[0][:, 1]
        return float(self.edge_weights.ravel() @ pull)

    def deformation(self, u: FloatArray) -> FloatArray:
        """Return the deformation gradients at the quadrature points, [element, point, 9]."""
        strain = np.matmul(_flat(self._operator), u[self._dofs][:, :, None])
        return np.asarray(strain.reshape(*self.weights.shape, 9) + np.eye(3).ravel())

    def _gripped(self, u: FloatArray, grip: Grip | None) -> tuple[FloatArray, Grip]:
        """Solve with the springs' limits of the last round until those stand still."""
        weights = self.edge_weights.ravel()
        pressure = -PENALTY_PER_M * self.contact(u)[2] if grip is None else grip.pressure
        for _ in range(_GRIP_LIMIT):
            points, distance, _ = self.contact(u)
            self.springs = Springs(grip, points, distance.gradient, self._friction * pressure)
            u = self._newton(u, self._clamped)
            points, _, depth = self.contact(u)
            before, pressure = pressure, -PENALTY_PER_M * depth
            if weights @ np.abs(pressure - before) <= _GRIP_TOLERANCE * (weights @ pressure):
                return u, self.springs.drawn(points, pressure)
        raise ConvergenceError(
            f"emulated gel: friction finds no equilibrium with the tip at "
            f"{self._tip_z_m * 1e3:.3f} mm",
            remedy="press in smaller steps",
        )

    def _newton(self, u: FloatArray, held: Int64Array) -> FloatArray:
        free = np.setdiff1d(np.arange(u.size), held)
        energy = self._energy(u)
        iteration = 0
        while np.isfinite(energy) and iteration < _ITERATION_LIMIT:
            residual, stiffness = self._linearise(u)
            step = solved(stiffness, -residual, free)
            if residual @ step > 0.0:
                # Contact on a rounded edge made the tangent indefinite: leave its curvature out.
                residual, stiffness = self._linearise(u, curvature=0.0)
                step = solved(stiffness, -residual, free)
            u, energy, taken = self._search(u, step, energy, slope=float(residual @ step))
            iteration += 1
            if taken * np.abs(step).max() < _STEP_TOLERANCE_M:
                return u
        raise ConvergenceError(
            f"emulated gel: no equilibrium after {iteration} Newton steps with the tip at "
            f"{self._tip_z_m * 1e3:.3f} mm above the base",
            remedy="press in smaller steps, or less deep",
        )

    def _search(
        self, u: FloatArray, step: FloatArray, energy: float, *, slope: float
    ) -> tuple[FloatArray, float, float]:
        """Halve the step until the energy falls enough (Armijo); return also its scale."""
        scale, tolerance = 1.0, 1e-12 * abs(energy)
        for _ in range(_BACKTRACK_LIMIT):
            found = self._energy(u + scale * step)
            if found <= energy + _SUFFICIENT * scale * slope + tolerance:
                return u + scale * step, found, scale
            scale *= 0.5
        return u + scale * step, self._energy(u + scale * step), scale

    def _energy(self, u: FloatArray) -> float:
        points, _, depth = self.contact(u)
        surface = 0.5 * PENALTY_PER_M * depth**2
        if self.springs is not None:
            surface = surface + self.springs.energy(points)
        inside = np.sum(self.weights * self.law.energy(self.deformation(u)))
        return float(inside + self.edge_weights.ravel() @ surface)

    def _linearise(self, u: FloatArray, *, curvature: float = 1.0) -> tuple[FloatArray, csc_matrix]:
        """Return the residual force and its derivative; without ``curvature`` of the tip."""
        force, stiffness = self._elastic(u)
        points, distance, depth = self.contact(u)
        gradient, inside = distance.gradient, depth[:, None, None]
        pull = PENALTY_PER_M * depth[:, None] * gradient
        square = gradient[:, :, None] * gradient[:, None, :]
        block = PENALTY_PER_M * (inside < 0.0) * (square + curvature * inside * distance.hessian)
        if self.springs is not None:
            gripping, sticking = self.springs.linearised(points)
            pull, block = pull + gripping, block + sticking
        shape, weights = self.edge_shape, self.edge_weights
        pull, block = pull.reshape(*weights.shape, 2), block.reshape(*weights.shape, 2, 2)
        edge_force = np.einsum("eq,qi,eqa->eia", weights, shape, pull)
        edges = np.einsum("eq,qi,qj,eqab->eiajb", weights, shape, shape, block)
        residual = assembled(self._dofs, force, u.size)
        residual = residual + assembled(self._edge_dofs, edge_force, u.size)
        blocks = ((self._dofs, stiffness), (self._edge_dofs, edges))
        return residual, assembled_matrix(blocks, u.size)

    def _elastic(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the elements' forces [element, 18] and stiffness [element, 18, 18]."""
        stress, tangent = self.law.linearised(self.deformation(u))
        weighted = (stress * self.weights[..., None]).reshape(len(stress), -1, 1)
        force = np.matmul(np.swapaxes(_flat(self._operator), 1, 2), weighted)[..., 0]
        return force, _stiffness(self._operator, tangent, self.weights)


def solved(matrix: csc_matrix, load: FloatArray, free: Int64Array) -> FloatArray:
    """Return the solution over the ``free`` degrees of freedom, zero at the others."""
    found = np.zeros_like(load)
    try:
        part, kind = matrix[free][:, free], {"SymmetricMode": True}
        factor = splu(part, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=kind)
    except RuntimeError as error:
        raise ConvergenceError("emulated gel: the tangent stiffness is singular") from error
    found[free] = factor.solve(load[free])
    return found


def dofs_of(nodes: Int64Array, per_node: int) -> Int64Array:
    """Return the degrees of freedom of rows of nodes, shape [row, nodes times per_node]."""
    dofs = per_node * nodes[:, :, None] + np.arange(per_node)
    return np.asarray(dofs.reshape(len(nodes), -1))


def assembled(dofs: Int64Array, local: FloatArray, size: int) -> FloatArray:
    """Return the sum of local values over the degrees of freedom, shape [size]."""
    return np.asarray(np.bincount(dofs.ravel(), local.ravel(), minlength=size), np.float64)


def assembled_matrix(blocks: Sequence[tuple[Int64Array, FloatArray]], size: int) -> csc_matrix:
    """Return the sum of local matrices, each with its rows of degrees of freedom."""
    rows = [np.repeat(dofs, dofs.shape[1], axis=1).ravel() for dofs, _ in blocks]
    columns = [np.tile(dofs, dofs.shape[1]).ravel() for dofs, _ in blocks]
    values = np.concatenate([local.ravel() for _, local in blocks])
    places = np.concatenate(rows), np.concatenate(columns)
    return coo_matrix((values, places), shape=(size, size)).tocsc()


def gradient_operator(mesh: QuadMesh, along: FloatArray, around: FloatArray) -> FloatArray:
    """Return d(deformation gradient)/d(dofs of the nodes) [1/m], [element, point, 9, dofs].

    Args:
        along: Motion along r, the angle and z by the dofs of a node, shape [3, dofs].
        around: Its change around the axis, likewise.
    """
    shape, derivative, radius, _ = mesh.at_quadrature()
    slopes = np.insert(derivative, 1, shape / radius[..., None], axis=2)
    operator = np.einsum("epjn,jia->epijna", slopes, np.stack([along, around, along]))
    return np.asarray(operator.reshape(*radius.shape, 9, -1))


def _stiffness(operator: FloatArray, tangent: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the elements' stiffness, [element, dofs, dofs]."""
    scaled = np.matmul(tangent * weights[..., None, None], operator)
    return np.asarray(np.matmul(np.swapaxes(_flat(operator), 1, 2), _flat(scaled)))


def _flat(values: FloatArray) -> FloatArray:
    return values.reshape(len(values), -1, values.shape[-1])


_ALONG = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
_AROUND = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
"""Of a motion (r, z) that is alike all around."""
STICK_PER_M = 5e5  # times Young's modulus: what sticks creeps by tenths of a micrometre


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip:
    """Where the surface was when the tip last stood still."""

    points: FloatArray  # (r, z) of its points from the tip [m], shape [point_count, 2]
    # Tractions on the tip over Young's modulus, shape [point_count]; zero out of contact.
    pull: FloatArray  # along the tip's surface
    pressure: FloatArray


class Springs:
    """The springs of one round, which stand for Coulomb friction.

    Each point in contact hangs on the tip by a stiff spring along the surface. Drawn beyond
    friction times pressure it slips. Pressure and direction are those of the round before, so that
    the springs have an energy (that of Huber) and Newton's method a line search.

    Args:
        before: Where the surface was; None begins without any pull.
        points: (r, z) of the surface's points from the tip now [m], shape [point_count, 2].
        normal: Out of the tip, likewise.
        limit: Largest pull over Young's modulus, shape [point_count].
    """

    def __init__(
        self, before: Grip | None, points: FloatArray, normal: FloatArray, limit: FloatArray
    ) -> None:
        begun = before or Grip(points=points, pull=np.zeros_like(points), pressure=limit)
        self._along = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
        self._begin = begun.points
        self._pull = np.sum(begun.pull * self._along, axis=-1)
        self._limit = limit

    def sticks(self, points: FloatArray) -> FloatArray:
        """Return one for each point that is in contact and does not slip, else zero."""
        return np.asarray(np.abs(self._trial(points)) < self._limit, dtype=np.float64)

    def energy(self, points: FloatArray) -> FloatArray:
        """Return the energy over Young's modulus [m], shape [point_count]."""
        size = np.abs(self._trial(points))
        kept = np.minimum(size, self._limit)
        return np.asarray(kept * (size - 0.5 * kept) / STICK_PER_M)

    def linearised(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the pull [point_count, 2] and its derivative [1/m], [point_count, 2, 2]."""
        pull = np.clip(self._trial(points), -self._limit, self._limit)
        stiffness = STICK_PER_M * self.sticks(points)
        square = self._along[:, :, None] * self._along[:, None, :]
        return pull[:, None] * self._along, stiffness[:, None, None] * square

    def drawn(self, points: FloatArray, pressure: FloatArray) -> Grip:
        """Return what the next press begins with."""
        return Grip(points=points, pull=self.linearised(points)[0], pressure=pressure)

    def _trial(self, points: FloatArray) -> FloatArray:
        moved = np.sum((points - self._begin) * self._along, axis=-1)
        return np.asarray(self._pull + STICK_PER_M * moved)


_MOTION = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_MOTION_AROUND = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
"""Of (a, s, c): along r and z as the cosine of the angle, along the angle as its sine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltResponse:
    """The response to a tilt of one radian."""

    displacement: FloatArray  # along r and z on the side that the tip tilts to [m], [node_count, 2]
    # On the tip about its lowest point, over Young's modulus, against the tilt [m^3].
    moment: float = 0.0
    # On the tip towards the side that it tilts to, over Young's modulus [m^2]; small beside F_z and
    # known to its half only, since the rim's contact decides on it.
    side_force: float = 0.0


def tilt_response(solver: GelSolver, pressed: Equilibrium) -> TiltResponse:
    """Return how a press answers a tilt of its tip."""
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
    _, tangent = solver.law.linearised(solver.deformation(u))
    operator = gradient_operator(mesh, _MOTION, _MOTION_AROUND)
    # The mean of a squared cosine around the axis is a half.
    inside = _stiffness(operator, tangent, 0.5 * solver.weights)
    stiffness = ((gel_dofs, inside), (edge_dofs, edges))
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
