"""Tables by which a surface is drawn: circles drawn round, steep faces cut, nodes' neighbours.

A revolved mesh follows a circle by straight edges. Where the surface bends sharply within the
height of the arc over its chord, as on a punch's wall, the nodes of one circle deform to a star:
those in the middle of chords come out right, those at the ends lie too far out, by half the arc's
height. Only for drawing, the nodes at the ends of chords are put onto the smooth closed curve
through those in the middle.

Heights are interpolated as a graph over the image, from facet to facet. Where a wall is steep, its
quadratic face is seen as a narrow sliver, and a graph through its six nodes is not the face. A face
is cut in sixteen, all of them the same quadratic surface. Edges of which only one face is cut stay
straight seen from above, as the other face draws them. A face's places are the points of a grid of
eighths: its six nodes, six more on each edge, and 21 inside. Which faces are steep changes with
every press; the tables serve whichever are.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicSpline

from sim.mesh.elements import FACE_EDGES, QUARTERS, quadratic_triangle_values
from tacauchy_rig.core.arrays import AnyArray, FloatArray, IntArray

_SAME_RADIUS_M = 1e-9
_SAME_ANGLE_RAD = 1e-6
_SECTORS_MIN = 4


def round_rings(
    rest: FloatArray, faces: IntArray, axis_m: tuple[float, float]
) -> dict[str, AnyArray]:
    """Return what draws circles of a revolved mesh smooth, as tables of ``node_kernel.Gel``.

    A periodic cubic spline is linear in its values: its weights are fixed by the mesh at rest.
    """
    offset = rest[:, :2] - np.array(axis_m)
    radius, angle = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])
    rings = list(_rings(faces, radius, angle))
    sectors = max((len(rays) for rays, _ in rings), default=0)
    between, on_rays, weights = [], [], []
    for rays, middles in rings:
        if len(rays) == sectors:
            ordered = middles[np.argsort(angle[middles])]
            turn = np.append(angle[ordered], angle[ordered[0]] + 2.0 * np.pi)
            ones = np.eye(sectors)[[*range(sectors), 0]]
            weights.append(CubicSpline(turn, ones, bc_type="periodic")(angle[rays]))
            between.append(ordered)
            on_rays.append(rays)
    shape = (len(between), sectors)
    return {
        "angle": angle,
        "between": np.array(between, dtype=np.int32).reshape(shape),
        "on_rays": np.array(on_rays, dtype=np.int32).reshape(shape),
        "weights": np.array(weights, dtype=np.float64).reshape(*shape, sectors),
    }


def _rings(
    faces: IntArray, radius: FloatArray, angle: FloatArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the complete rings: those of corners, and those in the middle between two of them.

    Of each, the nodes on the rays between sectors, and those in the middle of sectors.

    A node in the middle of an edge belongs to the ring that the radii of its ends name: they are
    equal on a chord; of a ring between two others, it is an edge along a ray or a diagonal.
    """
    _, circle = np.unique(np.round(radius / _SAME_RADIUS_M), return_inverse=True)
    corners = np.unique(faces[:, :3])
    edges = faces[:, [[0, 1, 3], [1, 2, 4], [2, 0, 5]]].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    nodes = np.concatenate([corners, edges[:, 2]])
    ends = np.concatenate([np.stack([corners, corners], axis=1), edges[:, :2]])
    names = np.sort(circle[ends], axis=1)
    turn = angle[ends[:, 0]] - angle[ends[:, 1]]
    on_ray = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi) < _SAME_ANGLE_RAD
    _, ring_of = np.unique(names, axis=0, return_inverse=True)
    order = np.argsort(ring_of, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(ring_of.ravel()[order])) + 1):
        on_rays, between = nodes[members[on_ray[members]]], nodes[members[~on_ray[members]]]
        if len(on_rays) == len(between) >= _SECTORS_MIN:
            yield on_rays, between


_EIGHTHS = 8
_FACE_NODES = ((8, 0, 0), (0, 8, 0), (0, 0, 8), (4, 4, 0), (0, 4, 4), (4, 0, 4))
_ON_EDGE = (1, 2, 3, 5, 6, 7)


@cache
def cut_face() -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the places of a face; the first 24 are its nodes and those on its edges.

    As ``values`` and ``straight`` of ``node_kernel.Gel``, of 45 places, and as the places of the
    parts' nodes, shape [16, 6].
    """
    places = list(_FACE_NODES)
    for a, b in FACE_EDGES:
        for step in _ON_EDGE:
            place = [0, 0, 0]
            place[a], place[b] = _EIGHTHS - step, step
            places.append((place[0], place[1], place[2]))
    inner = [(a, b, _EIGHTHS - a - b) for a in range(1, _EIGHTHS) for b in range(1, _EIGHTHS - a)]
    places += [place for place in inner if place not in places]
    number = {place: index for index, place in enumerate(places)}
    values = quadratic_triangle_values(np.array(places) / _EIGHTHS)
    parts = []
    straight = np.zeros((len(places), 3))
    for quarter in _in_four(np.array(_FACE_NODES)):
        corners, middles = quarter[:3], quarter[3:]
        to_local = np.linalg.inv(corners.T.astype(np.float64))
        for sixteenth in _in_four(quarter):
            nodes = [number[tuple(place)] for place in sixteenth.tolist()]
            parts.append(nodes)
            shapes = quadratic_triangle_values(sixteenth @ to_local.T)
            for edge, (_, _, opposite) in enumerate(((0, 1, 2), (1, 2, 0), (2, 0, 1))):
                bent = 3 + np.flatnonzero(middles[:, opposite] == 0)
                straight[nodes, edge] = shapes[:, bent].sum(axis=1)
    return values, straight, np.array(parts, dtype=np.int32)


def _in_four(nodes: IntArray) -> list[IntArray]:
    """Return the four parts of a face with six nodes in eighths, each with six."""
    parts = [nodes[list(part)] for part in QUARTERS]
    return [np.concatenate([part, (part + np.roll(part, -1, axis=0)) // 2]) for part in parts]


def cut_tables(faces: IntArray, node_count: int) -> dict[str, AnyArray]:
    """Number the nodes that cutting quadratic faces would add after a mesh's own."""
    ends = np.stack([faces[:, :3], np.roll(faces[:, :3], -1, axis=1)], axis=-1).reshape(-1, 2)
    _, first, edge, uses = np.unique(
        np.sort(ends, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    last = order[np.cumsum(uses) - 1]
    other = np.where(np.arange(len(edge)) == first[edge], last[edge], first[edge])
    across = np.where(uses[edge] == 2, other // 3, -1).reshape(-1, 3)
    count, steps = len(_ON_EDGE), np.arange(len(_ON_EDGE))
    forward = (ends[:, 0] < ends[:, 1])[:, None]
    on_edges = count * edge[:, None] + np.where(forward, steps, steps[::-1])
    values, straight, parts = cut_face()
    inner = len(values) - 6 - 3 * count
    own = count * len(first) + np.arange(len(faces) * inner).reshape(-1, inner)
    added = np.concatenate([on_edges.reshape(-1, 3 * count), own], axis=1)
    place_of = np.broadcast_to(6 + np.arange(added.shape[1]), added.shape)
    face_of = np.broadcast_to(np.arange(len(faces))[:, None], added.shape)
    _, at = np.unique(added, return_index=True)
    face, place = face_of.reshape(-1)[at], place_of.reshape(-1)[at]
    on_edge = place < 6 + 3 * count
    beside = np.where(on_edge, across[face, np.where(on_edge, (place - 6) // count, 0)], -1)
    nodes = np.concatenate([faces, node_count + added], axis=1)
    return {
        "parts": np.concatenate([faces, nodes[:, parts].reshape(-1, 6)]),
        "values": values,
        "straight": straight,
        "across": across,
        "face": face,
        "beside": beside,
        "place": place,
    }


def two_rings(triangles: IntArray, node_count: int) -> dict[str, IntArray]:
    """Return the nodes at most two edges from each node, as tables of ``node_kernel.Gel``."""
    start = triangles[:, [0, 1, 2, 1, 2, 0]].ravel()
    end = triangles[:, [1, 2, 0, 0, 1, 2]].ravel()
    one_ring = sparse.csr_matrix((np.ones(len(start)), (start, end)), shape=(node_count,) * 2)
    rings = (one_ring + one_ring @ one_ring).tolil()
    rings.setdiag(0.0)
    found = rings.tocsr()
    found.eliminate_zeros()
    return {"neighbour_starts": found.indptr, "neighbours": found.indices}
