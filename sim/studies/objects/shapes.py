"""Five bodies to press into a gel, from sharp edges to smooth curves, made from their formulas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.scene.indenter import MeshIndenter, mesh_indenter

_HEIGHT_M = 4e-3
_AROUND = 192


def bar() -> MeshIndenter:
    """Return a bar of 8 x 1.5 mm: four straight sharp edges."""
    return _prism(0.5e-3 * np.array([[8.0, 1.5], [-8.0, 1.5], [-8.0, -1.5], [8.0, -1.5]]), "bar")


def hexagon() -> MeshIndenter:
    """Return a hexagon key of 4 mm across its flats."""
    angle = np.radians(30.0 + 60.0 * np.arange(6))
    radius = 2e-3 / np.cos(np.radians(30.0))
    return _prism(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), "hexagon")


def cross() -> MeshIndenter:
    """Return a cross of 5 mm with arms of 1.5 mm: corners that point in and out."""
    arm, half = 2.5, 0.75
    quarter = np.array([[arm, -half], [arm, half], [half, half]])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    corners = [quarter @ np.linalg.matrix_power(turn, k) for k in range(4)]
    return _prism(1e-3 * np.concatenate(corners), "cross")


def ring() -> MeshIndenter:
    """Return a torus of 4.4 mm across its middle line and 1.2 mm thick: one smooth curved line."""
    major, minor = 2.2e-3, 0.6e-3
    u, v = np.meshgrid(_turn(_AROUND), _turn(_AROUND // 2), indexing="ij")
    out = major + minor * np.cos(v)
    vertices = np.stack([out * np.cos(u), out * np.sin(u), minor * np.sin(v)], axis=-1)
    return mesh_indenter(
        vertices.reshape(-1, 3), _quads(*u.shape, closed_rows=True), name="object ring"
    )


def ellipsoid() -> MeshIndenter:
    """Return an ellipsoid with half axes of 3, 1.8 and 2 mm: smooth, of no one radius."""
    axes = 1e-3 * np.array([3.0, 1.8, 2.0])
    count = _AROUND // 2
    polar = np.linspace(0.0, np.pi, count + 1)[1:-1]
    p, a = np.meshgrid(polar, _turn(_AROUND), indexing="ij")
    belt = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1)
    vertices = np.concatenate([belt.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]) * axes
    faces = [_quads(count - 1, _AROUND, closed_rows=False)]
    top, last = len(vertices) - 2, (count - 2) * _AROUND
    first = np.arange(_AROUND)
    following = (first + 1) % _AROUND
    faces.append(np.stack([np.full(_AROUND, top), first, following], axis=1))
    faces.append(np.stack([np.full(_AROUND, top + 1), last + following, last + first], axis=1))
    return mesh_indenter(vertices, np.concatenate(faces), name="object ellipsoid")


def chisel() -> MeshIndenter:
    """Return a chisel: an edge of 4 mm, from which faces fall off by 30 degrees all around."""
    edge, height, slope = 2e-3, 3e-3, np.tan(np.radians(30.0))
    reach = height / slope
    top = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (edge + reach, reach)
    vertices = np.concatenate(
        [[[edge, 0.0, 0.0], [-edge, 0.0, 0.0]], np.column_stack([top, np.full(4, height)])]
    )
    faces = [[0, 2, 5], [1, 4, 3], [0, 1, 3], [0, 3, 2], [0, 5, 4], [0, 4, 1], [2, 3, 4], [2, 4, 5]]
    return mesh_indenter(vertices, np.array(faces, dtype=np.int32), name="chisel")


OBJECTS: dict[str, Callable[[], MeshIndenter]] = {
    "bar": bar,
    "hexagon": hexagon,
    "cross": cross,
    "ring": ring,
    "ellipsoid": ellipsoid,
}


def _prism(outline: FloatArray, name: str) -> MeshIndenter:
    """Extrude an outline that is seen whole from its middle, shape [n, 2] [m]."""
    count = len(outline)
    lower = np.column_stack([outline, np.zeros(count)])
    upper = np.column_stack([outline, np.full(count, _HEIGHT_M)])
    vertices = np.concatenate([lower, upper, [[0.0, 0.0, 0.0], [0.0, 0.0, _HEIGHT_M]]])
    i = np.arange(count)
    j = (i + 1) % count
    faces = np.concatenate(
        [
            np.stack([i, j, j + count], axis=1),
            np.stack([i, j + count, i + count], axis=1),
            np.stack([np.full(count, 2 * count), j, i], axis=1),
            np.stack([np.full(count, 2 * count + 1), i + count, j + count], axis=1),
        ]
    )
    return mesh_indenter(vertices, faces, name=f"object {name}")


def _turn(count: int) -> FloatArray:
    return np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)


def _quads(rows: int, columns: int, *, closed_rows: bool) -> IntArray:
    """Return two triangles for each cell of a grid that closes along its columns."""
    last = rows if closed_rows else rows - 1
    i, j = np.meshgrid(np.arange(last), np.arange(columns), indexing="ij")
    down, right = (i + 1) % rows, (j + 1) % columns
    a, b = i * columns + j, down * columns + j
    c, d = down * columns + right, i * columns + right
    first, second = np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
