"""Steep quadratic faces, cut so that they are drawn as they are curved: which nodes that adds.

Heights are interpolated as a graph over the image, from facet to facet. Where a wall is steep, its
quadratic face is seen as a narrow sliver, and a graph through its six nodes is not the face. A face
is cut in sixteen, all of them the same quadratic surface; what was solved is not changed. Edges of
which only one face is cut stay straight seen from above, as the other face draws them.

A face's places are the points of a grid of eighths: its six nodes, six more on each edge, and 21
inside. Which faces are steep changes with every press; the tables here serve whichever are.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from sim.mesh.elements import FACE_EDGES, QUARTERS, quadratic_triangle_values
from tacauchy_rig.core.arrays import AnyArray, FloatArray, IntArray

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
    """Number the nodes that cutting quadratic faces, shape [face_count, 6], would add.

    They come after the mesh's own, in tables of ``node_kernel.Gel``.
    """
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
