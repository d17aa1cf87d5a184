"""A disc of gel under a tip, and its nine-node mesh in the (r, z) half-plane, fine at the tip."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from drivers.emulators.plant.tips import CylinderTip, Tip
from tacauchy_rig.core.arrays import FloatArray, Int64Array


@dataclass(frozen=True, slots=True, kw_only=True)
class GelDisc:
    """The gel at rest.

    Attributes:
        radius_m: Radius of the disc [m].
        thickness_m: Height of its highest point above the clamped base [m].
        dome_radius_m: Radius of the domed top [m]; inf is flat.
        layers: From the base upwards, each with its share of the height and its modulus over that
            of the uppermost; empty for a gel of one material.
    """

    radius_m: float = 12.9e-3
    thickness_m: float = 4.0e-3
    dome_radius_m: float = 134e-3
    layers: tuple[tuple[float, float], ...] = ()

    def sag(self, radius: FloatArray) -> FloatArray:
        """Return how far the surface lies below its highest point at ``radius`` [m]."""
        return 0.5 * radius**2 / self.dome_radius_m


# Raise them when the numbers or the fields change, so that old tables are not used: a ball's, a
# face's.
_BALL_VERSION, _FACE_VERSION = 2, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class PressCase:
    """Everything a table depends on. Young's modulus is not here: forces scale with it.

    Attributes:
        friction: Coulomb coefficient between tip and gel.
        max_depth_m: Depth of the last row asked for [m]; a table may end a little earlier where
            the gel finds no equilibrium any more.
    """

    tip: Tip = field(default_factory=lambda: CylinderTip(diameter_m=5e-3))
    gel: GelDisc = field(default_factory=GelDisc)
    poisson: float = 0.48
    max_depth_m: float = 1.0e-3
    friction: float = 0.0

    @property
    def has_face(self) -> bool:
        """The tip has a flat face, which may be tilted; a ball looks alike from all sides."""
        return isinstance(self.tip, CylinderTip)

    def file_name(self) -> str:
        """Return a name made from the content."""
        numbers = {name: value for name, value in asdict(self).items() if value != 0.0}
        version = _FACE_VERSION if self.has_face else _BALL_VERSION
        content = f"{version} {type(self.tip).__name__} {_rounded(numbers)}"
        digest = hashlib.sha256(content.encode()).hexdigest()[:16]
        return f"{type(self.tip).__name__.lower()}-{self.tip.diameter_m * 1e3:g}mm-{digest}.npz"


def _rounded(values: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return the items in order, with digits that survive a round trip through text."""
    found: list[tuple[str, Any]] = []
    for name, value in sorted(values.items()):
        if isinstance(value, dict):
            found.append((name, _rounded(value)))
        elif not isinstance(value, tuple):
            found.append((name, f"{value:.9g}"))
        elif value:  # a gel of one material has the name it had before there were layers
            found.append((name, [f"{share:.9g} {ratio:.9g}" for share, ratio in value]))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Grading:
    """Where elements are fine; from there they grow by a constant factor.

    Without friction the gel is squeezed out from under the rim by a few hundred micrometres, so
    the fine band has to begin inside the rim, or coarse elements snap around its edge one by one.

    Attributes:
        fine_from_m, fine_to_m: Radii between which elements have ``fine_size_m`` [m].
        growth: Ratio of neighbouring element sizes outside that band.
        top_size_m: Thickness of the uppermost elements [m].
        largest_m: No element is longer than this [m].
    """

    fine_from_m: float
    fine_to_m: float
    fine_size_m: float
    growth: float = 1.4
    top_size_m: float = 5e-5
    largest_m: float = 1.2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadMesh:
    """Nodes and nine-node elements.

    Attributes:
        nodes: (r, z) [m], z = 0 at the clamped base, shape [node_count, 2].
        elements: Node numbers, lexicographic with r fastest, shape [element_count, 9].
        top_edges: Nodes of each element edge on the top, inwards to outwards, [edge_count, 3].
        base_nodes, axis_nodes: Nodes on z = 0 and on r = 0.
        stiffness: Modulus of each element over that of the uppermost layer, [element_count].
    """

    nodes: FloatArray
    elements: Int64Array
    top_edges: Int64Array
    base_nodes: Int64Array
    axis_nodes: Int64Array
    stiffness: FloatArray

    def at_quadrature(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return what 3 x 3 Gauss points need.

        Returns:
            Shape values [point, 9]; their derivatives by r and z [1/m], [element, point, 2, 9];
            radius [m] and area [m^2] of each point, [element, point].
        """
        points, weights = np.polynomial.legendre.leggauss(3)
        value, slope = line_shape(points)
        shape = np.einsum("pj,qi->pqji", value, value).reshape(9, 9)
        by_xi = np.einsum("pj,qi->pqji", value, slope).reshape(9, 9)
        by_eta = np.einsum("pj,qi->pqji", slope, value).reshape(9, 9)
        corners = self.nodes[self.elements]
        jacobian = np.stack(
            [np.einsum("gn,ena->ega", by_xi, corners), np.einsum("gn,ena->ega", by_eta, corners)],
            axis=-2,
        )
        derivative = np.einsum(
            "egab,gbn->egan", np.linalg.inv(jacobian), np.stack([by_xi, by_eta], axis=1)
        )
        radius = np.einsum("gn,en->eg", shape, corners[..., 0])
        return (
            shape,
            derivative,
            radius,
            np.outer(weights, weights).ravel() * np.linalg.det(jacobian),
        )


def mesh_disc(disc: GelDisc, grading: Grading) -> QuadMesh:
    """Mesh ``disc``; element boundaries fall on both ends of the fine band."""
    g = grading
    fine_count = max(1, round((g.fine_to_m - g.fine_from_m) / g.fine_size_m))
    inner = g.fine_from_m - _growing(g.fine_size_m, g.fine_from_m, g)[::-1]
    fine = np.linspace(g.fine_from_m, g.fine_to_m, fine_count + 1)
    outer = g.fine_to_m + _growing(g.fine_size_m, disc.radius_m - g.fine_to_m, g)
    radii = _with_midpoints(np.concatenate([inner[:-1], fine, outer[1:]]))
    rows = 1.0 - _growing(g.top_size_m, disc.thickness_m, g)[::-1] / disc.thickness_m
    rows = _with_interfaces(rows, disc)
    layers = _with_midpoints(rows)
    height = disc.thickness_m - disc.sag(radii)
    r = np.broadcast_to(radii, (layers.size, radii.size))
    nodes = np.stack([r.ravel(), np.outer(layers, height).ravel()], axis=-1)
    number = np.arange(nodes.shape[0]).reshape(layers.size, radii.size)
    elements = np.stack(
        [number[j : j - 2 or None : 2, i : i - 2 or None : 2] for j in range(3) for i in range(3)],
        axis=-1,
    ).reshape(-1, 9)
    top = number[-1]
    return QuadMesh(
        nodes=nodes,
        elements=elements,
        top_edges=np.stack([top[:-2:2], top[1:-1:2], top[2::2]], axis=-1),
        base_nodes=number[0],
        axis_nodes=number[:, 0],
        stiffness=np.repeat(_row_stiffness(rows, disc), radii.size // 2),
    )


def _with_interfaces(rows: FloatArray, disc: GelDisc) -> FloatArray:
    """Move the nearest boundary between element rows onto each interface of the layers."""
    moved = rows.copy()
    for interface in _interfaces(disc):
        moved[1 + int(np.argmin(np.abs(moved[1:-1] - interface)))] = interface
    return moved


def _row_stiffness(rows: FloatArray, disc: GelDisc) -> FloatArray:
    middle = 0.5 * (rows[1:] + rows[:-1])
    if not disc.layers:
        return np.ones_like(middle)
    ratios = np.array([ratio for _, ratio in disc.layers])
    stiffness: FloatArray = ratios[np.searchsorted(_interfaces(disc), middle)]
    return stiffness


def _interfaces(disc: GelDisc) -> FloatArray:
    """Return the relative heights at which one layer ends and the next begins."""
    shares = np.array([share for share, _ in disc.layers])
    interfaces: FloatArray = np.cumsum(shares)[:-1]
    return interfaces


def line_shape(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return quadratic shape functions on [-1, 1] and their derivatives, shape [points, 3]."""
    x = points
    value = np.stack([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)], axis=-1)
    slope = np.stack([x - 0.5, -2.0 * x, x + 0.5], axis=-1)
    return value, slope


def _growing(first: float, length: float, grading: Grading) -> FloatArray:
    """Return points from 0 to ``length`` whose spacing grows from about ``first``."""
    if length <= 0.0:
        return np.zeros(1)
    sizes: list[float] = []
    size = first
    while sum(sizes) < length:
        sizes.append(size)
        size = min(size * grading.growth, grading.largest_m)
    points = np.append(0.0, np.cumsum(sizes))
    scaled: FloatArray = points * (length / points[-1])
    return scaled


def _with_midpoints(corners: FloatArray) -> FloatArray:
    points = np.empty(2 * corners.size - 1)
    points[::2] = corners
    points[1::2] = 0.5 * (corners[1:] + corners[:-1])
    return points
