"""Steep quadratic faces, split so that they are drawn as they are curved.

Heights are interpolated as a graph over the image, from facet to facet. Where a wall is steep, its
quadratic face is seen as a narrow sliver, and a graph through its six nodes is not the face. A face
is cut in sixteen, all of them the same quadratic surface; what was solved is not changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.fields.surface import SurfaceState
from sim.mesh.elements import linear_facets, quadratic_triangle_values
from sim.optics.height.gradient_recovery import FACE_NODES, shape_derivatives

_STEEP_SLOPE = 0.5
_TIMES = 2
# Corners of the four parts of a face among its nodes.
_PARTS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


def with_steep_faces_split(surface: SurfaceState) -> SurfaceState:
    """Return a surface whose steep faces are cut in sixteen; linear ones stay as they are."""
    if surface.triangles6 is None:
        return surface
    nodes = np.concatenate([surface.positions_rest, surface.positions], axis=1)
    steep = _is_steep(surface.positions, surface.triangles6)
    kept, faces = surface.triangles6[~steep], surface.triangles6[steep]
    for _ in range(_TIMES):
        nodes, faces = _in_four(nodes, faces)
    triangles6 = np.concatenate([kept, faces])
    return replace(
        surface,
        positions_rest=nodes[:, :3],
        positions=nodes[:, 3:],
        triangles=linear_facets(triangles6),
        triangles6=triangles6,
    )


def _is_steep(positions: FloatArray, triangles6: IntArray) -> NDArray[np.bool_]:
    """Mark the faces that are somewhere steeper than a limit, or hang over, shape [face_count]."""
    along = np.einsum("qkn,fnd->fqkd", shape_derivatives(), positions[triangles6])
    normal = np.cross(along[:, :, 0], along[:, :, 1])
    sideways = np.hypot(normal[..., 0], normal[..., 1])
    return np.asarray(np.any(sideways > _STEEP_SLOPE * normal[..., 2], axis=1))


def _in_four(nodes: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Cut every face in four.

    Edges of which only one face is cut stay straight seen from above, as the other face draws them.

    Args:
        nodes: At rest and deformed [m], shape [node_count, 6].
        faces: Shape [face_count, 6].

    Returns:
        The nodes, new ones at the end, and the parts, shape [4 face_count, 6].
    """
    corners = faces[:, _PARTS]
    ends = np.stack([corners, np.roll(corners, -1, axis=2)], axis=-1).reshape(-1, 2)
    middles = 0.5 * (FACE_NODES[_PARTS] + np.roll(FACE_NODES[_PARTS], -1, axis=1))
    shapes = np.apply_along_axis(quadratic_triangle_values, -1, middles)
    values = np.einsum("pmk,fkd->fpmd", shapes, nodes[faces]).reshape(-1, nodes.shape[1])
    edges, first, edge_of, uses = np.unique(
        np.sort(ends, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    new = values[first]
    rim = uses == 1
    new[rim, :2] = nodes[edges[rim], :2].mean(axis=1)
    new[rim, 3:5] = nodes[edges[rim], 3:5].mean(axis=1)
    numbers = len(nodes) + edge_of.reshape(*corners.shape)
    parts = np.concatenate([corners, numbers], axis=2).reshape(-1, 6)
    return np.concatenate([nodes, new]), parts.astype(np.int32)
