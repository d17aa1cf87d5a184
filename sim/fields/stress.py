"""Cauchy stress of a deformed gel: on its surface (paper, Algorithm 1), continuous, between layers.

The elements' stress jumps from one to the next, also within a layer, and its worst value is at
their faces. Its L2 projection onto functions that are linear between the vertices (Oden, Brauchli
1971) is continuous in a layer and of the order of the quadrature points' stress; the difference of
the two is the error estimate of Zienkiewicz and Zhu (1987) for the elements' stress.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse.linalg
import warp as wp

from sim.device import Device, on_host
from sim.fields.stress_projection_kernel import projection_kernel
from sim.mesh.cached_tet_mesh import tet_volumes
from sim.mesh.clamping_and_sparsity import assembled
from sim.mesh.elements import EDGES, boundary_faces, shape_gradients
from sim.scene.triangle_surface import renumbered
from sim.solve.model import Model
from tacauchy_rig.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceStress:
    """Algorithm 1 on every face that is not clamped, shape [face_count, ...]."""

    normals: FloatArray
    areas_m2: FloatArray
    traction_pa: FloatArray  # t = sigma n, sigma of the parent tetrahedron (mean over its points)
    normal_pa: FloatArray  # p_n = t . n; negative is compression
    tangential_pa: FloatArray  # t - p_n n


def surface_stress(model: Model, positions: FloatArray) -> SurfaceStress:
    """Project the elements' stress onto the surface (paper, Algorithm 1, Eq. 5-7)."""
    at = Device(model.device).array(positions[None], wp.vec3d)
    projection = StressProjection(model, at)
    projection.launch()
    return projection.fetch()[0]


class StressProjection:
    """Finds the stress on the surface of many environments where their nodes are on the device.

    Args:
        positions: Nodes [m], shape [environment_count, node_count], on the model's device.
        gel: Elements of the environments, as ``ElasticBody.of`` gives them; None is the model's.

    Attributes:
        found: On the device, shape [environment_count, face_count, 11]: normal, area [m^2],
            traction, its normal and its tangential part [Pa].
    """

    def __init__(self, model: Model, positions: Any, *, gel: Any = None) -> None:
        self._model, self._positions, self._gel = model, positions, gel
        device, count = Device(model.device), positions.shape[0]
        self.found = device.zeros((count, len(model.faces), 11), wp.float64)
        self._stress = model.gel.stress_buffer(count)
        weights = device.array(model.reference.weights, wp.float64)
        faces = device.array(model.faces, wp.int32), device.array(model.face_parents, wp.int32)
        kernel, shape = projection_kernel(model.reference.order), self.found.shape[:2]
        inputs = [*faces, weights, self._stress, positions]
        self._project = device.record(kernel, shape, [*inputs, self.found])

    def launch(self) -> None:
        """Find it where the nodes are now."""
        self._model.gel.find_stress(self._positions, self._stress, gel=self._gel)
        self._project.launch()

    def fetch(self) -> list[SurfaceStress]:
        """Return what the last launch found, environment by environment."""
        return [
            SurfaceStress(
                normals=each[:, :3],
                areas_m2=each[:, 3],
                traction_pa=each[:, 4:7],
                normal_pa=each[:, 7],
                tangential_pa=each[:, 8:],
            )
            for each in np.array(on_host(self.found))
        ]


# Of a symmetric tensor, in VTK's order: xx, yy, zz, xy, yz, xz.
_ROWS, _COLUMNS = (0, 1, 2, 0, 1, 0), (0, 1, 2, 1, 2, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class CauchyStress:
    """Stress of a whole model [Pa]."""

    cells_pa: FloatArray  # mean over each tetrahedron's points, shape [tet_count, 3, 3]
    nodes_pa: FloatArray  # recovered; of the layer above where two meet, [node_count, 3, 3]
    # Estimated error of each tetrahedron's own stress: root mean square of the norm of what it and
    # the recovered one are apart, shape [tet_count]
    errors_pa: FloatArray


def cauchy_stress(model: Model, positions: FloatArray) -> CauchyStress:
    """Return the stress where the nodes are [m], shape [node_count, 3]."""
    raw, weights = model.gel.cauchy_stress(positions), model.reference.weights
    layers = model.mesh.labels
    nodes, errors = np.zeros((len(model.nodes), 3, 3)), np.zeros(len(raw))
    for layer in range(int(layers.max()) + 1):
        own = layers == layer
        elements, at_vertices = model.elements[own], recovered_stress(model, positions, own)
        corners = at_vertices[elements[:, :4]]
        nodes[elements[:, :4]] = corners
        for middle, (a, b) in zip(elements[:, 4:].T, EDGES, strict=False):
            nodes[middle] = 0.5 * (at_vertices[elements[:, a]] + at_vertices[elements[:, b]])
        apart = np.einsum("qc,ecij->eqij", model.reference.points, corners) - raw[own]
        errors[own] = np.sqrt(np.einsum("q,eqij,eqij->e", weights, apart, apart))
    cells = np.einsum("q,eqij->eij", weights, raw)
    return CauchyStress(cells_pa=cells, nodes_pa=nodes, errors_pa=errors)


def recovered_stress(model: Model, positions: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the stress recovered at the vertices of one layer's tetrahedra [Pa], zero elsewhere.

    Positions are the deformed nodes' [m], [node_count, 3]; ``chosen`` says which tetrahedra are of
    the layer, [tet_count].
    """
    corners = model.elements[chosen, :4]
    vertices, local = renumbered(corners)
    values, weights = model.reference.points, model.reference.weights
    volumes = tet_volumes(model.nodes, corners)
    blocks = volumes[:, None, None] * np.einsum("q,qa,qb->ab", weights, values, values)
    if len(weights) == 1:
        # One point cannot tell four vertices apart: lumped, it is the mean over the neighbours.
        blocks = 0.25 * volumes[:, None, None] * np.eye(4)
    # Symmetric: the transpose is the same matrix, by columns.
    mass = assembled(blocks, local, len(vertices)).T
    stress = model.gel.cauchy_stress(positions)[chosen].reshape(*blocks.shape[:1], len(weights), 9)
    loads = np.einsum("e,q,qa,eqs->eas", volumes, weights, values, stress)
    right = np.zeros((len(vertices), 9))
    np.add.at(right, local, loads)
    found = np.zeros((len(model.mesh.vertices), 9))
    found[vertices] = scipy.sparse.linalg.splu(mass).solve(right)
    return found.reshape(-1, 3, 3)


def components(tensors: FloatArray) -> FloatArray:
    """Return xx, yy, zz, xy, yz, xz of symmetric tensors, shape [..., 6]."""
    return np.asarray(tensors[..., _ROWS, _COLUMNS])


@dataclass(frozen=True, slots=True, kw_only=True)
class StressOnSides:
    """t = sigma n on an interface, from below and from above; one in the exact solution."""

    below_pa: FloatArray  # sigma of the lower layer, shape [face_count, point_count, 3]
    above_pa: FloatArray  # sigma of the upper layer, same shape
    areas_m2: FloatArray  # deformed area of each point, shape [face_count, point_count]

    @property
    def jump_relative(self) -> float:
        """Norm of the traction's jump over the norm of its mean, both over the interface."""
        jump = ((self.above_pa - self.below_pa) ** 2).sum(axis=2)
        mean = ((0.5 * (self.above_pa + self.below_pa)) ** 2).sum(axis=2)
        size = float((mean * self.areas_m2).sum())
        return float(np.sqrt((jump * self.areas_m2).sum() / size)) if size > 0.0 else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceTraction:
    """One interface of a deformed gel.

    The elements' own stress is discontinuous. That of a stiff skin is worth little across it: the
    error scales with the skin's modulus, the traction with the soft gel's.
    """

    below: BoolArray  # which tetrahedra lie below it, shape [tet_count]
    faces: IntArray  # on it, shape [face_count, face_node_count]
    # Of the gel below on the gel above for the whole pad, +z in compression as the force on the
    # indenter is, shape [3]: minus the sum of all other nodal forces of the gel below, which
    # equilibrium makes equal to the base's force, but for the weight in between
    force_n: FloatArray
    element: StressOnSides  # by the stress of each element


def interface_traction(model: Model, positions: FloatArray) -> tuple[InterfaceTraction, ...]:
    """Return the traction on every interface from the base upwards; none in a gel of one layer."""
    labels, found, gradient = model.mesh.labels, [], model.gel.gradient(positions)
    for below in (labels <= layer for layer in range(int(labels.max()))):
        faces, under, over = _shared_faces(model.elements, below)
        inner = np.setdiff1d(model.elements[below], faces)
        sides = (_stress_on_faces(model, positions, faces, each) for each in (under, over))
        element = on_sides(model, positions, faces, *sides)
        whole_n = model.mesh.symmetry.whole_force(gradient[inner].sum(axis=0))
        found.append(InterfaceTraction(below=below, faces=faces, force_n=whole_n, element=element))
    return tuple(found)


def on_sides(
    model: Model, positions: FloatArray, faces: IntArray, below_pa: FloatArray, above_pa: FloatArray
) -> StressOnSides:
    """Return the tractions of stresses at the points of faces, shape [f, p, 3, 3]."""
    vectors = model.reference.area_vectors(positions[faces])
    areas = np.linalg.norm(vectors, axis=2)
    normals = vectors / areas[..., None]
    lower, upper = (np.einsum("fpij,fpj->fpi", each, normals) for each in (below_pa, above_pa))
    return StressOnSides(below_pa=lower, above_pa=upper, areas_m2=areas)


def _shared_faces(elements: IntArray, below: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the faces between two sets of elements and the element on either side of each."""
    sides, stride = [], int(elements.max()) + 1
    for side in (below, ~below):
        chosen = np.flatnonzero(side).astype(np.int32)
        faces, parents = boundary_faces(elements[chosen])
        a, b, c = np.sort(faces[:, :3], axis=1).astype(np.int64).T
        sides.append((faces, chosen[parents], (a * stride + b) * stride + c))
    (faces, under, low), (_, over, high) = sides
    _, here, there = np.intersect1d(low, high, assume_unique=True, return_indices=True)
    return faces[here], under[here], over[there]


def _stress_on_faces(
    model: Model, positions: FloatArray, faces: IntArray, parents: IntArray
) -> FloatArray:
    """Return the stress of one side's elements at the faces' points, shape [f, p, 3, 3]."""
    nodes = model.elements[parents]
    points = model.reference.face_points
    barycentric = np.zeros((len(faces), len(points), 4))
    for corner in range(3):
        place = np.argmax(nodes[:, :4] == faces[:, corner, None], axis=1)
        barycentric[np.arange(len(faces)), :, place] = points[:, corner]
    gradients = shape_gradients(model.reference.order, barycentric)
    deformed = np.einsum("fnx,fpny->fpxy", positions[nodes], gradients)
    deformations = deformed @ model.discretisation.inverse_jacobians[parents, None]
    stress = model.gel.stress_at(deformations.reshape(-1, 3, 3), np.repeat(parents, len(points)))
    return stress.reshape(deformations.shape)
