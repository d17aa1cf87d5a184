"""Regular meshes of a box, their refinement to a sizing field, and the fit of their vertices.

The regular meshes are of cells of six tetrahedra around a diagonal (Kuhn): halving the longest
edges of such cells gives three shapes of tetrahedra and no others. An edge is halved when it is the
longest of every tetrahedron around it, so that the mesh stays conforming; where it is not, the
longer edges of those tetrahedra are halved first (Rivara 1997). Results are equal on every machine.

Vertices are then moved onto the pad's top and the rim of the contact, where no element gets too
flat. FTetWild's top may be 30 um off, several per cent of the force at a press of 0.5 mm, and an
element that the rim of a punch crosses acts as if the punch were wider.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
import scipy
from numpy.typing import NDArray

from sim.mesh.cached_tet_mesh import TetMesh, oriented, tet_volumes
from sim.mesh.elements import EDGES, boundary_faces, edges_of
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.pad import BoxPad, Pad, SurfacePad
from tacauchy_rig.core.arrays import BoolArray, FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.time_limit_and_progress import check_time

Numbers = NDArray[np.int64]
# An edge of 3/2 becomes two of 3/4: lengths are the target's on average, by and large.
_TOO_LONG = 1.5
_TETS_MAX = 400_000
# Of a sensor's mesh: edge length gained per depth below the surface.
_SENSOR_SLOPE = 0.5


def brick_mesh(
    pad: BoxPad,
    *,
    spacing_m: float,
    symmetry: MirrorSymmetry,
    interface_shares: Sequence[float] = (),
) -> TetMesh:
    """Mesh a box, or the part that stands for the whole, by cells of at most ``spacing_m`` [m].

    Args:
        interface_shares: Of the height, where layers meet, rising.
    """
    planes = np.array([0.0, *interface_shares, 1.0])
    counts = [math.ceil(part * pad.height_m / spacing_m) for part in np.diff(planes)]
    levels = np.interp(np.arange(sum(counts) + 1), np.cumsum([0, *counts]), planes)
    axes = []
    mirrored = symmetry.mirror_x, symmetry.mirror_y
    for half, is_mirrored in zip(pad.half_extents(), mirrored, strict=True):
        first = 0.0 if is_mirrored else -half
        axes.append(np.linspace(first, half, math.ceil((half - first) / spacing_m) + 1))
    axes.append(levels)
    cells = tuple(len(axis) - 1 for axis in axes)
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    vertices[:, 2] *= pad.height_at(vertices[:, 0], vertices[:, 1])
    name = f"{cells[0]}x{cells[1]}x{cells[2]} cells"
    tets, layers = kuhn_tets(cells), None
    if len(interface_shares):
        above = np.searchsorted(np.cumsum(counts), np.arange(cells[2]), side="right")
        layers = above[tets.min(axis=1) % len(levels)].astype(np.int32)
    mesh = TetMesh(vertices=vertices, tets=tets, name=name, symmetry=symmetry, layers=layers)
    return oriented(mesh)


def kuhn_tets(cells: tuple[int, ...]) -> IntArray:
    """Return the tetrahedra of a grid of cells, shape [6 cell_count, 4], the last axis fastest."""
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    corners = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1)
    first = corners.reshape(-1, 3) @ strides
    ways = [np.append(0, np.cumsum(strides[list(order)])) for order in permutations(range(3))]
    return np.concatenate([first[:, None] + way for way in ways]).astype(np.int32)


def bisected(mesh: TetMesh, size_at: Callable[[FloatArray], FloatArray]) -> TetMesh:
    """Halve edges until none is longer than 3/2 of the target length [m] at its middle.

    Edges are numbered as they come, and found again by name: both ends in one number.
    """
    vertices, tets, layers, fresh = mesh.vertices, mesh.tets, mesh.labels, mesh.tets
    names, lengths, too_long = np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.bool_)
    known, numbers = names, names  # in order
    of_tets, longest = np.zeros((len(EDGES), 0), np.int64), names  # a column for each
    while True:
        check_time()
        # What came last is not known yet: its edges, and the longest of every tetrahedron.
        one, other = (fresh[:, list(ends)].astype(np.int64) for ends in zip(*EDGES, strict=True))
        keys = np.minimum(one, other) * _TETS_MAX + np.maximum(one, other)
        found, place = np.unique(keys, return_inverse=True)
        at = np.searchsorted(known, found)
        new = np.append(known, -1)[at] != found
        known = np.insert(known, at[new], found[new])
        numbers = np.insert(numbers, at[new], len(names) + np.arange(int(new.sum())))
        names = np.concatenate([names, found[new]])
        ends = _ends(vertices, found[new])
        added = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        lengths = np.concatenate([lengths, added])
        too_long = np.concatenate([too_long, added > _TOO_LONG * size_at(ends.mean(axis=1))])
        own = numbers[np.searchsorted(known, found)][place].reshape(keys.shape)
        # Of equally long ones the last by name is the longest.
        most = lengths[own] == lengths[own].max(axis=1, keepdims=True)
        last = np.where(most, keys, -1).argmax(axis=1)
        of_tets = np.concatenate([of_tets, own.T], axis=1)
        longest = np.concatenate([longest, own[np.arange(len(own)), last]])
        if not too_long.any():
            kept = None if mesh.layers is None else layers
            return replace(mesh, vertices=vertices, tets=tets, layers=kept)
        wanted = np.flatnonzero(_wanted(of_tets, longest, too_long))
        wanted = wanted[np.argsort(names[wanted])]
        too_long[wanted] = False
        number = np.full(len(names), -1, dtype=np.int32)
        number[wanted] = len(vertices) + np.arange(len(wanted))
        vertices = np.concatenate([vertices, _ends(vertices, names[wanted]).mean(axis=1)])
        split = number[longest] >= 0
        edge, parents, whole = longest[split], tets[split], ~split
        halves = [
            np.where(parents == end[:, None], number[edge][:, None], parents)
            for end in np.divmod(names[edge], _TETS_MAX)
        ]
        fresh = np.concatenate(halves)
        tets = np.concatenate([tets[whole], fresh])
        of_tets, longest = of_tets[:, whole], longest[whole]
        layers = np.concatenate([layers[whole], layers[split], layers[split]])
        if len(tets) > _TETS_MAX:
            raise ConfigError(
                f"the mesh would have more than {_TETS_MAX} tetrahedra",
                remedy="use a coarser preset, or larger mesh settings",
            )


def _ends(vertices: FloatArray, names: Numbers) -> FloatArray:
    """Return the ends of named edges [m], shape [n, 2, 3]."""
    return np.asarray(vertices[np.column_stack(np.divmod(names, _TETS_MAX))])


def bisected_level(base: TetMesh, pad: Pad, size_at: Callable[[FloatArray], FloatArray]) -> TetMesh:
    """Refine as if the top were flat: what halves an edge of a dome's top lies on the dome."""
    if isinstance(pad, SurfacePad):
        return bisected(base, size_at)

    def share(points: FloatArray) -> FloatArray:
        height = pad.height_at(points[:, 0], points[:, 1]) / pad.height_m
        return np.column_stack([np.ones((len(points), 2)), height])

    level = replace(base, vertices=base.vertices / share(base.vertices))
    fine = bisected(level, lambda points: size_at(points * share(points)))
    return replace(fine, vertices=fine.vertices * share(fine.vertices))


def sensor_mesh(pad: BoxPad, *, edge_m: float, interface_shares: Sequence[float] = ()) -> TetMesh:
    """Mesh a box, flat or domed, that any indenter may press anywhere: fine all over its top.

    Args:
        edge_m: Edge length at the surface [m]; a quadratic element has nodes at half of it.
        interface_shares: Of the height, where layers meet, rising.

    Raises:
        ConfigError: It asks for more tetrahedra than can be solved for.
    """
    coarse_m = max(edge_m, pad.height_m)

    def size_at(points: FloatArray) -> FloatArray:
        depth = pad.height_at(points[:, 0], points[:, 1]) - points[:, 2]
        return (edge_m + _SENSOR_SLOPE * depth).clip(max=coarse_m)

    base = brick_mesh(
        pad, spacing_m=coarse_m, symmetry=MirrorSymmetry(), interface_shares=interface_shares
    )
    mesh = bisected_level(base, pad, size_at)
    # Flat faces between points of a dome lie below it: on average they are to lie on it.
    top = pad.height_at(mesh.vertices[:, 0], mesh.vertices[:, 1])
    ends, _ = edges_of(mesh.tets)
    ends = ends[np.isclose(mesh.vertices[ends, 2], top[ends], rtol=0.0, atol=1e-9).all(axis=1)]
    middles = mesh.vertices[ends].mean(axis=1)
    below_m = np.mean(pad.height_at(middles[:, 0], middles[:, 1]) - middles[:, 2])
    raised = mesh.vertices.copy()
    raised[:, 2] *= 1.0 + below_m / top
    return replace(mesh, vertices=raised, name=f"sensor, edges of {edge_m * 1e3:.3g} mm")


def _wanted(of_tets: Numbers, longest: Numbers, too_long: BoolArray) -> BoolArray:
    """Return which edges are to be halved now, no two of one tetrahedron."""
    marked = np.zeros(len(too_long), dtype=np.bool_)
    reached = too_long[of_tets].any(axis=0)
    while True:
        marked[longest[reached]] = True
        spread = marked[of_tets].any(axis=0)
        if np.array_equal(spread, reached):
            break
        reached = spread
    around = np.bincount(of_tets.reshape(-1), minlength=len(marked))
    agreeing = np.bincount(longest, minlength=len(marked))
    return np.asarray(marked & (around == agreeing))


# Of its volume: what an element must keep when its vertices are moved.
_FLAT_SHARE = 0.2
_ROUNDS = 40
_ON_TOP_M = 1e-9


def with_top_fitted(mesh: TetMesh, pad: Pad, *, reach_m: float) -> TetMesh:
    """Move the vertices within ``reach_m`` [m] of the pad's top onto it."""
    outer, heights = _outer(mesh, pad)
    at = mesh.vertices[outer]
    near = (np.abs(at[:, 2] - heights) < reach_m) & (at[:, 2] > reach_m)
    wanted = mesh.vertices.copy()
    wanted[outer[near], 2] = heights[near]
    return replace(mesh, vertices=_moved(mesh, wanted))


def with_rim_fitted(mesh: TetMesh, pad: Pad, rim: FloatArray, *, reach_m: float) -> TetMesh:
    """Move the top's vertices within ``reach_m`` [m] of a rim onto it.

    Its points [m], shape [count, 3], are much closer to each other than the vertices, and mirrored
    by the planes that mirror the mesh.
    """
    if not len(rim):
        return mesh
    outer, heights = _outer(mesh, pad)
    top = outer[np.abs(mesh.vertices[outer, 2] - heights) < _ON_TOP_M]
    distance, nearest = scipy.spatial.cKDTree(rim).query(mesh.vertices[top])
    near = distance < reach_m
    wanted = mesh.vertices.copy()
    wanted[top[near]] = rim[nearest[near]]
    mirrored = [mesh.symmetry.mirror_x, mesh.symmetry.mirror_y, False]
    wanted[:, mirrored] = np.abs(wanted[:, mirrored])
    wanted[mesh.symmetry.on_plane(mesh.vertices, reach_m)] = 0.0
    return replace(mesh, vertices=_moved(mesh, wanted))


def _outer(mesh: TetMesh, pad: Pad) -> tuple[IntArray, FloatArray]:
    """Return the vertices of the mesh's surface and the height of the pad there."""
    outer = np.unique(boundary_faces(mesh.tets)[0])
    return outer, pad.height_at(mesh.vertices[outer, 0], mesh.vertices[outer, 1])


def _moved(mesh: TetMesh, wanted: FloatArray) -> FloatArray:
    """Return the wanted vertices [m], without those moves that would flatten a tetrahedron."""
    least = _FLAT_SHARE * tet_volumes(mesh.vertices, mesh.tets)
    moved = wanted.copy()
    for _ in range(_ROUNDS):
        flat = mesh.tets[tet_volumes(moved, mesh.tets) < least]
        if not len(flat):
            return moved
        travel = np.linalg.norm(moved - mesh.vertices, axis=1)
        farthest = flat[np.arange(len(flat)), np.argmax(travel[flat], axis=1)]
        moved[farthest] = mesh.vertices[farthest]
    return mesh.vertices
