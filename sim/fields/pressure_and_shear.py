"""Pressure and shear on the gel's surface, from the contact's own forces (paper, Algorithm 2).

A face has more contact points than its displacement can obey at once, so that what a single point
carries scatters about what acts there; moments over a few faces do not. The traction at a node is
therefore the value of the polynomial that fits the contact points best around it, weighted by
their areas on the deformed surface and by the sum of the linear shape functions of the vertices of
the node's own faces, which falls to zero at the patch's edge. It is of the element's order.

Contact ends with an infinite slope (Hertz) or in a jump (a sharp rim): a polynomial through what
is touched and what is not smears both. The more of its own faces is touched, the less do points
that are not touched count at a node. A node none of whose faces is touched carries nothing.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse

from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import WholeSurface
from sim.scene.triangle_surface import renumbered, unit
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray, IntArray

_LEAST_WEIGHT = 1e-6  # keeps the fit of a node with few touched points determined
_BLOCK = 256  # nodes that are fitted at once, for memory


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceTraction:
    """Recovered contact traction on the gel at every node of a model; zero away from contact."""

    pressure_pa: FloatArray  # -p_n of the paper: positive presses on the gel, shape [node_count]
    tangential_pa: FloatArray  # t_tau, shape [node_count, 3]
    normals: FloatArray  # outward unit normals of the deformed surface, shape [node_count, 3]

    @property
    def traction_pa(self) -> FloatArray:
        """Traction t = t_tau - p n, shape [node_count, 3]."""
        return np.asarray(self.tangential_pa - self.pressure_pa[:, None] * self.normals)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactTraction:
    """Contact forces on the gel, by contact point or by vertex."""

    arms_m: FloatArray  # from the indenter's tip [m], shape [..., 3]
    normals: FloatArray  # outward ones of the indenter, zero where nothing touches, [..., 3]
    normal_n: FloatArray  # normal force [N]; positive presses on the gel
    tangential_n: FloatArray  # tangential force [N], shape [..., 3]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMeasures:
    """Sums over the contact points of an equilibrium; units in the names."""

    moment_nm: FloatArray  # about the indenter's tip, shape [3]
    area_m2: float
    area_seen_m2: float
    gap_min_m: float


def contact_measures(model: Model, point: PathPoint) -> ContactMeasures:
    """Sum moment and area over the contact points."""
    contact, symmetry = point.equilibrium.contact, model.mesh.symmetry
    normals = model.surface.area_vectors(point.state.positions)
    areas = np.linalg.norm(normals, axis=2)
    touching = np.linalg.norm(contact.forces, axis=2) > 0.0
    arms = contact.points - point.state.tip
    return ContactMeasures(
        moment_nm=symmetry.whole_moment(np.cross(arms, contact.forces).reshape(-1, 3).sum(axis=0)),
        area_m2=symmetry.copies * float(areas[touching].sum()),
        area_seen_m2=symmetry.copies * float(np.abs(normals[..., 2])[touching].sum()),
        gap_min_m=float(contact.gaps.min()),
    )


def contact_forces(point: PathPoint) -> ContactTraction:
    """Split the contact forces on the gel along the indenter's normals, [face, point, ...].

    A contact that grips nothing has no tangential forces.
    """
    contact, grip = point.equilibrium.contact, point.state.grip
    normals = unit(contact.forces if grip is None else grip.loads @ point.state.rotation.T)
    along = -np.einsum("fpi,fpi->fp", contact.forces, normals)
    across = -contact.forces - along[..., None] * normals
    return ContactTraction(
        arms_m=contact.points - point.state.tip,
        normals=normals,
        normal_n=np.abs(along),
        tangential_n=across if grip is not None else np.zeros_like(across),
    )


def surface_traction(model: Model, point: PathPoint) -> SurfaceTraction:
    """Recover the contact's traction at the nodes."""
    vectors = model.surface.area_vectors(point.state.positions)
    normals = np.zeros(model.nodes.shape)
    np.add.at(normals, model.faces, vectors.sum(axis=1)[:, None])
    size = float(np.abs(model.mesh.vertices).max())
    normals = unit(np.where(model.mesh.symmetry.on_plane(model.nodes, size), 0.0, normals))
    pressure, tangential = np.zeros(len(normals)), np.zeros(normals.shape)
    for nodes, values in _fitted(model, point, np.linalg.norm(vectors, axis=2), normals):
        found = np.maximum(values[:, 0], 0.0)
        pressure[nodes] = found
        along = values[:, 1:] * (found > 0.0)[:, None]
        across = np.einsum("ni,ni->n", along, normals[nodes])
        tangential[nodes] = along - across[:, None] * normals[nodes]
    return SurfaceTraction(pressure_pa=pressure, tangential_pa=tangential, normals=normals)


def _fitted(
    model: Model, point: PathPoint, areas: FloatArray, normals: FloatArray
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield touched nodes and what was fitted there, pressure and shear [Pa], a block at a time.

    The contact points are those of the whole surface; their areas are of the deformed one [m^2].
    """
    contact, split = point.equilibrium.contact, contact_forces(point)
    nodes, local = renumbered(model.faces)
    whole = WholeSurface(model.mesh.symmetry, model.nodes[nodes])
    faces = whole.copies(local)
    forces = np.concatenate([split.normal_n[..., None], split.tangential_n], axis=2)
    loads = forces / areas[..., None]
    signs = list(model.mesh.symmetry.signs())
    points = np.concatenate([contact.points * sign for sign in signs])
    values = np.concatenate([loads * np.append(1.0, sign) for sign in signs])
    areas = np.tile(areas, (len(signs), 1))
    touched = np.tile(np.any(contact.forces != 0.0, axis=2), (len(signs), 1))
    degree = 2 if model.reference.order is ElementOrder.P2 else 1
    around, at_vertices = (_incidence(each, int(faces.max()) + 1) for each in (faces, faces[:, :3]))
    own = around[whole.numbers]
    held = (own @ (areas * touched).sum(axis=1)) / (own @ areas.sum(axis=1))
    chosen = np.flatnonzero(held > 0.0)
    for first in range(0, len(chosen), _BLOCK):
        block = chosen[first : first + _BLOCK]
        core = (own[block] @ at_vertices.T) > 0
        patch = ((core @ at_vertices) > 0).tocoo()
        order = np.argsort(patch.row, kind="stable")
        row, face = patch.row[order], patch.col[order]
        corners = np.asarray(core.todense())[row[:, None], faces[face, :3]]
        counted = np.where(touched[face], 1.0, (1.0 - held[block])[row, None]) + _LEAST_WEIGHT
        offsets = points[face] - point.state.positions[nodes[block]][row, None]
        across = normals[nodes[block]]
        first_way = unit(np.cross(across, np.eye(3)[np.argmin(np.abs(across), axis=1)]))
        plane = np.stack([first_way, np.cross(across, first_way)], axis=1)
        flat = np.einsum("apx,aux->apu", offsets, plane[row])
        weights = areas[face] * (corners @ model.reference.face_points.T) * counted
        yield nodes[block], _at_origin(flat, values[face], weights, row, degree)


def _incidence(faces: IntArray, size: int) -> scipy.sparse.csr_matrix:
    """Return which nodes are of which faces, shape [size, face_count]."""
    columns = np.repeat(np.arange(len(faces)), faces.shape[1])
    ones = np.ones(faces.size)
    return scipy.sparse.csr_matrix((ones, (faces.reshape(-1), columns)), (size, len(faces)))


def _at_origin(
    offsets: FloatArray, values: FloatArray, weights: FloatArray, row: IntArray, degree: int
) -> FloatArray:
    """Return the values at zero of the polynomials that fit best, by ``row`` of the pairs."""
    starts = np.flatnonzero(np.diff(row, prepend=-1))
    reach = np.maximum.reduceat(np.abs(offsets).max(axis=(1, 2)), starts)
    x, y = np.moveaxis(offsets / reach[row][:, None, None], 2, 0)
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    terms = np.stack([x**i * y**j for i, j in powers], axis=1)
    weighted = terms * weights[:, None]
    system = np.add.reduceat(weighted @ np.swapaxes(terms, 1, 2), starts)
    return np.asarray(np.linalg.solve(system, np.add.reduceat(weighted @ values, starts))[:, 0])
