"""Nine-node mesh of a disc of gel in the (r, z) half-plane, fine where a tip presses it."""

from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.truth import GelDisc
from tacauchy_rig.core.arrays import FloatArray, Int64Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Grading:
    """Where elements are fine; from there they grow by a constant factor.

    Without friction the gel is squeezed out from under the rim by a few hundred micrometres, so
    the fine band has to begin inside the rim, or coarse elements snap around its edge one by one.
    """

    # Radii between which elements have ``fine_size_m`` [m].
    fine_from_m: float
    fine_to_m: float
    fine_size_m: float
    growth: float = 1.4  # ratio of neighbouring element sizes outside that band
    top_size_m: float = 5e-5  # thickness of the uppermost elements [m]
    largest_m: float = 1.2e-3  # no element is longer than this [m]

    def grown(self, first: float, length: float) -> FloatArray:
        """Return points from 0 to ``length`` whose spacing grows from about ``first`` [m]."""
        if length <= 0.0:
            return np.zeros(1)
        sizes: list[float] = []
        size = first
        while sum(sizes) < length:
            sizes.append(size)
            size = min(size * self.growth, self.largest_m)
        points = np.append(0.0, np.cumsum(sizes))
        return np.asarray(points * (length / points[-1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadMesh:
    """Nodes and nine-node elements."""

    nodes: FloatArray  # (r, z) [m], z = 0 at the clamped base, shape [node_count, 2]
    elements: Int64Array  # node numbers, lexicographic with r fastest, shape [element_count, 9]
    # Nodes of each element edge on the top, inwards to outwards, [edge_count, 3].
    top_edges: Int64Array
    # Nodes on z = 0 and on r = 0.
    base_nodes: Int64Array
    axis_nodes: Int64Array
    # Modulus of each element over that of the uppermost layer, [element_count].
    stiffness: FloatArray

    def at_quadrature(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return what 3 x 3 Gauss points need.

        Returns:
            Shape values [point, 9]; their derivatives by r and z [1/m], [element, point, 2, 9];
            radius [m] and area [m^2] of each point, [element, point].
        """
        points, weights = np.polynomial.legendre.leggauss(3)
        value, slope = line_shape(points)
        shape = np.kron(value, value).astype(np.float64)
        local = np.stack([np.kron(value, slope), np.kron(slope, value)], axis=1)
        corners = self.nodes[self.elements]
        jacobian = np.einsum("gan,enb->egab", local, corners)
        derivative = np.linalg.solve(jacobian, local)
        radius = corners[..., 0] @ shape.T
        return shape, derivative, radius, np.kron(weights, weights) * np.linalg.det(jacobian)

    def at_surface_quadrature(self) -> tuple[FloatArray, FloatArray]:
        """Return shape values [point, 3] and 2 pi r ds at rest [m^2], [edge, point]."""
        points, weights = np.polynomial.legendre.leggauss(4)
        shape, slope = line_shape(points)
        edges = self.nodes[self.top_edges]
        tangent = np.einsum("qi,eia->eqa", slope, edges)
        ring = 2.0 * np.pi * edges[..., 0] @ shape.T
        return shape, ring * np.linalg.norm(tangent, axis=-1) * weights


def mesh_disc(disc: GelDisc, grading: Grading) -> QuadMesh:
    """Mesh ``disc``; element boundaries fall on both ends of the fine band and on interfaces."""
    g = grading
    fine_count = max(1, round((g.fine_to_m - g.fine_from_m) / g.fine_size_m))
    inner = g.fine_from_m - g.grown(g.fine_size_m, g.fine_from_m)[::-1]
    fine = np.linspace(g.fine_from_m, g.fine_to_m, fine_count + 1)
    outer = g.fine_to_m + g.grown(g.fine_size_m, disc.radius_m - g.fine_to_m)
    radii = _with_midpoints(np.concatenate([inner[:-1], fine, outer[1:]]))
    rows = 1.0 - g.grown(g.top_size_m, disc.thickness_m)[::-1] / disc.thickness_m
    shares, moduli = np.array(disc.layers or ((1.0, 1.0),)).T
    interfaces = np.cumsum(shares)[:-1]
    for interface in interfaces:
        rows[1 + int(np.argmin(np.abs(rows[1:-1] - interface)))] = interface
    stiffness = moduli[np.searchsorted(interfaces, 0.5 * (rows[1:] + rows[:-1]))]
    layers = _with_midpoints(rows)
    height = disc.thickness_m - disc.sag(radii)
    r = np.broadcast_to(radii, (layers.size, radii.size))
    nodes = np.stack([r.ravel(), np.outer(layers, height).ravel()], axis=-1)
    number = np.arange(nodes.shape[0]).reshape(layers.size, radii.size)
    blocks = np.lib.stride_tricks.sliding_window_view(number, (3, 3))[::2, ::2]
    top = number[-1]
    return QuadMesh(
        nodes=nodes,
        elements=blocks.reshape(-1, 9),
        top_edges=np.stack([top[:-2:2], top[1:-1:2], top[2::2]], axis=-1),
        base_nodes=number[0],
        axis_nodes=number[:, 0],
        stiffness=np.repeat(stiffness, radii.size // 2),
    )


def line_shape(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return quadratic shape functions on [-1, 1] and their derivatives, shape [points, 3]."""
    x = points
    value = np.stack([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)], axis=-1)
    slope = np.stack([x - 0.5, -2.0 * x, x + 0.5], axis=-1)
    return value, slope


def _with_midpoints(corners: FloatArray) -> FloatArray:
    points = np.empty(2 * corners.size - 1)
    points[::2] = corners
    points[1::2] = 0.5 * (corners[1:] + corners[:-1])
    return points
