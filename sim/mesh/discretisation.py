"""A clamped pad's nodes, elements and touched faces, as one element type sees its mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.mesh.elements import (
    ElementOrder,
    ReferenceElement,
    boundary_faces,
    quadratic_nodes,
    reference_element,
)
from sim.mesh.sparsity import SparsePattern, sparse_pattern
from sim.mesh.tet_mesh import TetMesh
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

# Of the pad's height: what lies lower is on the clamped base.
_ON_BASE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Discretisation:
    """What of a pad is fixed by its mesh and element type.

    Attributes:
        nodes: At rest [m], shape [node_count, 3].
        elements: Nodes of every tetrahedron, its corners first.
        faces: Nodes of every face that may be touched, its corners first: those on the surface,
            neither clamped nor on a plane of symmetry.
        clamped: Nodes on the base, shape [node_count].
        jacobians: Of the tetrahedra at rest [m], shape [element_count, 3, 3].
        volumes: Of the tetrahedra at rest [m^3].
    """

    reference: ReferenceElement
    nodes: FloatArray
    elements: IntArray
    faces: IntArray
    face_parents: IntArray
    clamped: NDArray[np.bool_]
    pattern: SparsePattern
    jacobians: FloatArray
    volumes: FloatArray

    @property
    def corners(self) -> FloatArray:
        """Corners of the tetrahedra at rest [m], shape [element_count, 4, 3]."""
        return self.nodes[self.elements[:, :4]]

    @property
    def inverse_jacobians(self) -> FloatArray:
        """Inverses of ``jacobians`` [1/m]."""
        return np.asarray(np.linalg.inv(self.jacobians), dtype=np.float64)

    @property
    def face_areas(self) -> FloatArray:
        """Areas of the faces at rest [m^2], as if they were flat."""
        a, b, c = (self.nodes[self.faces[:, k]] for k in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    @property
    def touched_element(self) -> int:
        """The tetrahedron behind the highest face: its layer is the one that is touched."""
        heights = self.nodes[self.faces[:, :3], 2].mean(axis=1)
        return int(self.face_parents[np.argmax(heights)])


def discretise(mesh: TetMesh, *, order: ElementOrder) -> Discretisation:
    """Clamp a mesh at its base and give it an element type.

    Raises:
        ConfigError: A tetrahedron has no positive volume.
    """
    if order is ElementOrder.P2:
        nodes, elements = quadratic_nodes(mesh.vertices, mesh.tets)
    else:
        nodes, elements = mesh.vertices, mesh.tets
    faces, parents = boundary_faces(elements)
    clamped = nodes[:, 2] <= _ON_BASE * mesh.vertices[:, 2].max()
    held = mesh.symmetry.on_plane(nodes, float(np.abs(mesh.vertices).max()))
    outer = ~clamped[faces[:, :3]].all(axis=1)
    outer &= ~np.any(held[faces[:, :3]].all(axis=1), axis=1)
    corners = nodes[elements[:, :4]]
    jacobians = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    volumes = np.linalg.det(jacobians) / 6.0
    if volumes.min() <= 0.0:
        raise ConfigError(
            f"mesh has {int((volumes <= 0).sum())} tetrahedra of no positive volume",
            remedy="orient the tetrahedra or mesh the pad again",
        )
    return Discretisation(
        reference=reference_element(order),
        nodes=nodes,
        elements=elements,
        faces=faces[outer],
        face_parents=parents[outer],
        clamped=clamped,
        pattern=sparse_pattern(elements, held | clamped[:, None]),
        jacobians=jacobians,
        volumes=volumes,
    )
