"""Finite-strain equilibrium of a disc of gel under a rigid tip of revolution.

Nine-node quadrilaterals, full integration; unilateral contact by a stiff penalty on the distance to
the tip, with Coulomb friction by springs that slip; clamped base, free wall. Young's
modulus of the layer that is touched is one, so forces come out in square metres and scale with the
true modulus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from drivers.emulators.plant.neo_hookean import NeoHookean
from drivers.emulators.plant.quad_mesh import QuadMesh, line_shape
from drivers.emulators.plant.tips import Tip
from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import ConvergenceError

PENALTY_PER_M = 2e6  # times Young's modulus: the tip sinks in by p/E * 0.5 um
_ITERATION_LIMIT = 60
_BACKTRACK_LIMIT = 14
_SUFFICIENT = 0.1  # share of the decrease that a linear model promises
_STEP_TOLERANCE_M = 1e-10
_GRIP_LIMIT, _GRIP_TOLERANCE = 12, 2e-4  # rounds of friction, and their change over the pressure


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """One solution.

    Attributes:
        displacement: (u_r, u_z) [m], shape [node_count, 2].
        force: Force on the tip along the axis, over Young's modulus [m^2].
        contact_radius_m: Largest deformed radius in contact [m]; 0 out of contact.
        grip: How far the springs of friction are drawn; None without friction.
    """

    displacement: FloatArray
    force: float
    contact_radius_m: float
    grip: Grip | None = None


class GelSolver:
    """Presses one tip into one mesh; each call starts from the state it is given.

    Args:
        friction: Coulomb coefficient.

    Attributes:
        weights: 2 pi r dA times stiffness at the quadrature points [m^3], [element, point].
        edge_shape, edge_weights: Shape values of the surface's quadrature points, and 2 pi r ds at
            rest [m^2], [edge, point].
        springs: Of friction, as the last press left them; None without.
    """

    def __init__(self, mesh: QuadMesh, law: NeoHookean, *, friction: float = 0.0) -> None:
        self.mesh = mesh
        self.law = law
        self._friction = friction
        self.springs: Springs | None = None
        self._gradients, measure = _strain_operator(mesh)
        self.weights = measure * mesh.stiffness[:, None]
        self._dofs = (2 * mesh.elements[:, :, None] + np.arange(2)).reshape(-1, 18)
        self._edge_dofs = (2 * mesh.top_edges[:, :, None] + np.arange(2)).reshape(-1, 6)
        self.edge_shape, self.edge_weights = _surface_quadrature(mesh)
        rows = np.concatenate([dof_pairs(self._dofs, 0), dof_pairs(self._edge_dofs, 0)])
        columns = np.concatenate([dof_pairs(self._dofs, 1), dof_pairs(self._edge_dofs, 1)])
        self._pattern = _SparsePattern(rows, columns, 2 * mesh.nodes.shape[0])
        self._clamped = np.union1d(
            np.concatenate([2 * mesh.base_nodes, 2 * mesh.base_nodes + 1]), 2 * mesh.axis_nodes
        )

    def press(
        self, tip: Tip, tip_z_m: float, start: FloatArray, *, grip: Grip | None = None
    ) -> Equilibrium:
        """Return the equilibrium with the tip's lowest point at ``tip_z_m`` [m] above the base.

        Args:
            grip: Where the tip came from, in a press with friction.

        Raises:
            ConvergenceError: Newton's method did not converge from ``start``.
        """
        self.springs, u = None, start.ravel()
        if self._friction == 0.0 or grip is None:
            u = self._newton(u, self._clamped, tip, tip_z_m)
        if self._friction > 0.0:
            u, grip = self._gripped(u, grip, tip, tip_z_m)
        force, radius = self._contact_force(u, tip, tip_z_m)
        return Equilibrium(
            displacement=u.reshape(-1, 2), force=force, contact_radius_m=radius, grip=grip
        )

    def _gripped(
        self, u: FloatArray, grip: Grip | None, tip: Tip, tip_z: float
    ) -> tuple[FloatArray, Grip]:
        """Solve with the springs' limits of the last round until those stand still.

        Raises:
            ConvergenceError: They do not.
        """
        pressure = self._pressure(u, tip, tip_z) if grip is None else grip.pressure
        for _ in range(_GRIP_LIMIT):
            points = np.stack(self.surface_points(u, tip_z), axis=-1)
            normal = tip.distance(*points.T).gradient
            self.springs = Springs(grip, points, normal, self._friction * pressure)
            u = self._newton(u, self._clamped, tip, tip_z)
            before, pressure = pressure, self._pressure(u, tip, tip_z)
            weights = self.edge_weights.ravel()
            if weights @ np.abs(pressure - before) <= _GRIP_TOLERANCE * (weights @ pressure):
                points = np.stack(self.surface_points(u, tip_z), axis=-1)
                return u, self.springs.drawn(points, pressure)
        raise ConvergenceError(
            f"emulated gel: friction finds no equilibrium with the tip at {tip_z * 1e3:.3f} mm",
            remedy="press in smaller steps",
        )

    def _pressure(self, u: FloatArray, tip: Tip, tip_z: float) -> FloatArray:
        """Return the pressure over Young's modulus at the points of the surface."""
        distance = tip.distance(*self.surface_points(u, tip_z)).value
        return np.asarray(-PENALTY_PER_M * np.minimum(distance, 0.0))

    def _newton(self, u: FloatArray, held: Int64Array, tip: Tip, tip_z: float) -> FloatArray:
        free = np.setdiff1d(np.arange(u.size), held)
        energy = self._energy(u, tip, tip_z)
        iteration = 0
        while np.isfinite(energy) and iteration < _ITERATION_LIMIT:
            residual, stiffness = self._linearise(u, tip, tip_z)
            step = self._direction(residual, stiffness, free)
            if residual @ step > 0.0:
                # Contact on a rounded edge made the tangent indefinite: leave its curvature out.
                residual, stiffness = self._linearise(u, tip, tip_z, curvature=0.0)
                step = self._direction(residual, stiffness, free)
            slope = float(residual @ step)
            u, energy, taken = self._search(u, step, (energy, slope), tip, tip_z)
            iteration += 1
            if taken * np.abs(step).max() < _STEP_TOLERANCE_M:
                return u
        raise ConvergenceError(
            f"emulated gel: no equilibrium after {iteration} Newton steps with the tip at "
            f"{tip_z * 1e3:.3f} mm above the base",
            remedy="press in smaller steps, or less deep",
        )

    @staticmethod
    def _direction(residual: FloatArray, stiffness: csc_matrix, free: Int64Array) -> FloatArray:
        step = np.zeros_like(residual)
        step[free] = -_factor(stiffness, free).solve(residual[free])
        return step

    def _search(
        self,
        u: FloatArray,
        step: FloatArray,
        start: tuple[float, float],
        tip: Tip,
        tip_z: float,
    ) -> tuple[FloatArray, float, float]:
        """Halve the step until the energy falls enough (Armijo)."""
        energy, slope = start
        scale = 1.0
        tolerance = 1e-12 * abs(energy)
        for _ in range(_BACKTRACK_LIMIT):
            trial = u + scale * step
            trial_energy = self._energy(trial, tip, tip_z)
            if trial_energy <= energy + _SUFFICIENT * scale * slope + tolerance:
                return trial, trial_energy, scale
            scale *= 0.5
        return u + scale * step, self._energy(u + scale * step, tip, tip_z), scale

    def deformation(self, u: FloatArray) -> FloatArray:
        """Return the deformation gradients at the quadrature points, [element, point, 5]."""
        strain = np.matmul(self._gradients, u[self._dofs][:, :, None])[..., 0]
        identity = np.array([1.0, 0.0, 0.0, 1.0, 1.0])
        deformation: FloatArray = strain.reshape(*self.weights.shape, 5) + identity
        return deformation

    def _energy(self, u: FloatArray, tip: Tip, tip_z: float) -> float:
        energy = float(np.sum(self.weights * self.law.energy(self.deformation(u))))
        points, weights = self.surface_points(u, tip_z), self.edge_weights.ravel()
        depth = np.minimum(tip.distance(*points).value, 0.0)
        if self.springs is not None:
            energy += float(weights @ self.springs.energy(np.stack(points, axis=-1)))
        return energy + 0.5 * PENALTY_PER_M * float(weights @ depth**2)

    def _internal_force(self, u: FloatArray) -> FloatArray:
        stress = self.law.stress(self.deformation(u)) * self.weights[..., None]
        stress = stress.reshape(stress.shape[0], -1, 1)
        local = np.matmul(np.swapaxes(self._gradients, 1, 2), stress)[..., 0]
        return assembled(self._dofs, local, u.size)

    def _linearise(
        self, u: FloatArray, tip: Tip, tip_z: float, *, curvature: float = 1.0
    ) -> tuple[FloatArray, csc_matrix]:
        tangent = self.law.tangent(self.deformation(u)) * self.weights[..., None, None]
        element_count, point_count = self.weights.shape
        operator = self._gradients.reshape(element_count, point_count, 5, 18)
        scaled = np.matmul(tangent, operator).reshape(element_count, -1, 18)
        stiffness = np.matmul(np.swapaxes(self._gradients, 1, 2), scaled)
        contact_force, contact = self._contact(u, tip, tip_z, curvature)
        values = np.concatenate([stiffness.ravel(), contact.ravel()])
        return self._internal_force(u) + contact_force, self._pattern.matrix(values)

    def _contact(
        self, u: FloatArray, tip: Tip, tip_z: float, curvature: float
    ) -> tuple[FloatArray, FloatArray]:
        points = self.surface_points(u, tip_z)
        distance = tip.distance(*points)
        depth = np.minimum(distance.value, 0.0)
        weight = PENALTY_PER_M * self.edge_weights.ravel()
        pull = (weight * depth)[:, None] * distance.gradient
        square = distance.gradient[:, :, None] * distance.gradient[:, None, :]
        active = np.where(depth < 0.0, weight, 0.0)[:, None, None]
        block = active * (square + curvature * depth[:, None, None] * distance.hessian)
        if self.springs is not None:
            gripping, stiffness = self.springs.linearised(np.stack(points, axis=-1))
            pull = pull + self.edge_weights.ravel()[:, None] * gripping
            block = block + self.edge_weights.ravel()[:, None, None] * stiffness
        edge_count, point_count = self.edge_weights.shape
        shape = self.edge_shape
        force = np.einsum("qi,eqa->eia", shape, pull.reshape(edge_count, point_count, 2))
        local = np.einsum(
            "qi,qj,eqab->eiajb", shape, shape, block.reshape(edge_count, point_count, 2, 2)
        )
        return assembled(self._edge_dofs, force, u.size), local.reshape(edge_count, 6, 6)

    def _contact_force(self, u: FloatArray, tip: Tip, tip_z: float) -> tuple[float, float]:
        r, z = self.surface_points(u, tip_z)
        distance = tip.distance(r, z)
        touching = distance.value < 0.0
        if not touching.any():
            return 0.0, 0.0
        pressure = -PENALTY_PER_M * np.minimum(distance.value, 0.0) * self.edge_weights.ravel()
        return float(-np.sum(pressure * distance.gradient[:, 1])), float(r[touching].max())

    def surface_points(self, u: FloatArray, tip_z: float) -> tuple[FloatArray, FloatArray]:
        """Return r and z of the surface's quadrature points from the tip [m]."""
        position = (self.mesh.nodes + u.reshape(-1, 2))[self.mesh.top_edges]
        points = np.einsum("qi,eia->eqa", self.edge_shape, position).reshape(-1, 2)
        return points[:, 0], points[:, 1] - tip_z


class _SparsePattern:
    """Sums element entries into a fixed compressed-column matrix."""

    def __init__(self, rows: Int64Array, columns: Int64Array, size: int) -> None:
        keys, self._slot = np.unique(columns * size + rows, return_inverse=True)
        self._rows = (keys % size).astype(np.int32)
        self._starts = np.searchsorted(keys // size, np.arange(size + 1)).astype(np.int32)
        self._size = size

    def matrix(self, values: FloatArray) -> csc_matrix:
        data = np.bincount(self._slot, values, minlength=self._rows.size)
        return csc_matrix((data, self._rows, self._starts), shape=(self._size, self._size))


def _factor(stiffness: csc_matrix, free: Int64Array) -> SuperLU:
    try:
        return splu(
            stiffness[free][:, free], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise ConvergenceError("emulated gel: the tangent stiffness is singular") from error


def assembled(dofs: Int64Array, local: FloatArray, size: int) -> FloatArray:
    """Return the sum of local values over the degrees of freedom, shape [size]."""
    total = np.bincount(dofs.ravel(), local.ravel(), minlength=size)
    return total.astype(np.float64)


def dof_pairs(dofs: Int64Array, axis: int) -> Int64Array:
    """Return row (axis 0) or column numbers of the entries of local matrices."""
    count = dofs.shape[1]
    expanded = dofs[:, :, None] if axis == 0 else dofs[:, None, :]
    return np.broadcast_to(expanded, (dofs.shape[0], count, count)).ravel()


def _strain_operator(mesh: QuadMesh) -> tuple[FloatArray, FloatArray]:
    """Return d(deformation gradient)/d(dofs) [1/m] and 2 pi r dA [m^3] at 3 x 3 Gauss points."""
    shape, derivative, radius, area = mesh.at_quadrature()
    element_count = mesh.elements.shape[0]
    operator = np.zeros((element_count, 9, 5, 9, 2))
    operator[:, :, 0, :, 0] = operator[:, :, 2, :, 1] = derivative[:, :, 0]
    operator[:, :, 1, :, 0] = operator[:, :, 3, :, 1] = derivative[:, :, 1]
    operator[:, :, 4, :, 0] = shape / radius[..., None]
    return operator.reshape(element_count, 45, 18), 2.0 * np.pi * radius * area


def _surface_quadrature(mesh: QuadMesh) -> tuple[FloatArray, FloatArray]:
    """Return shape values [points, 3] and 2 pi r ds at rest [m^2], shape [edges, points]."""
    points, weights = np.polynomial.legendre.leggauss(4)
    shape, slope = line_shape(points)
    edges = mesh.nodes[mesh.top_edges]
    radius = np.einsum("qi,ei->eq", shape, edges[..., 0])
    tangent = np.einsum("qi,eia->eqa", slope, edges)
    return shape, 2.0 * np.pi * radius * np.linalg.norm(tangent, axis=-1) * weights


STICK_PER_M = 5e5
"""Times Young's modulus: what sticks creeps by tenths of a micrometre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip:
    """Where the surface was when the tip last stood still.

    Attributes:
        points: (r, z) of its points from the tip [m], shape [point_count, 2].
        pull: Along the tip, over Young's modulus, on the tip, likewise; zero out of contact.
        pressure: Likewise, shape [point_count].
    """

    points: FloatArray
    pull: FloatArray
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
        self.along = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
        self._begin = begun.points
        self._pull = np.einsum("pi,pi->p", begun.pull, self.along)
        self.limit = limit

    def sticks(self, points: FloatArray) -> FloatArray:
        """Return one for each point that is in contact and does not slip, else zero."""
        return np.asarray(np.abs(self._trial(points)) < self.limit, dtype=np.float64)

    def energy(self, points: FloatArray) -> FloatArray:
        """Return the energy over Young's modulus [m], shape [point_count]."""
        size = np.abs(self._trial(points))
        kept = np.minimum(size, self.limit)
        return np.asarray(kept * (size - 0.5 * kept) / STICK_PER_M)

    def linearised(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the pull [point_count, 2] and its derivative [1/m], [point_count, 2, 2]."""
        pull = np.clip(self._trial(points), -self.limit, self.limit)
        stiffness = STICK_PER_M * self.sticks(points)
        square = self.along[:, :, None] * self.along[:, None, :]
        return pull[:, None] * self.along, stiffness[:, None, None] * square

    def drawn(self, points: FloatArray, pressure: FloatArray) -> Grip:
        """Return what the next press begins with."""
        return Grip(points=points, pull=self.linearised(points)[0], pressure=pressure)

    def _trial(self, points: FloatArray) -> FloatArray:
        moved = np.einsum("pi,pi->p", points - self._begin, self.along)
        return np.asarray(self._pull + STICK_PER_M * moved)
