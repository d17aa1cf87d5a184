"""Heights per pixel of deformed surfaces of one gel, from the deformed mesh, on one device.

Where a revolved mesh bends sharply within the height of the arc over its chord, as on a punch's
wall, the nodes of one circle deform to a star: those at the ends of chords lie too far out, by half
the arc's height. Only for drawing, they are put onto the smooth closed curve through those in the
middle.

A steep face is a narrow sliver seen from above, and a graph through its six nodes is not the face:
it is cut in sixteen. Edges of which only one face is cut stay straight seen from above, as the
other face draws them. A face's places are the points of a grid of eighths: its six nodes, six more
on each edge, and 21 inside.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from scipy.interpolate import CubicSpline

from sim.contact.indenter_distance import Poses, body_of, poses_at
from sim.device import Device, filled
from sim.fields.saved_press import SurfaceState, TopSurface
from sim.mesh.elements import FACE_EDGES, QUARTERS, edges_of, quadratic_triangle_values
from sim.optics.height import pixel_height_kernel as by_pixel
from sim.optics.height import slope_kernel as kernels
from sim.scene.indenter import Indenter, IndenterSet, grown
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import AnyArray, BoolArray, FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

TOUCHING_M = 6e-6  # a little more than the gap that narrow barriers leave
_GAP_SHARE = 0.2  # of the solver's gap, by which it varies under the indenter
_GPU_LANES = 32  # threads of a facet: a face seen from near covers thousands of pixels
_FAR_M = 1.0  # above all gel


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMaps:
    """The gel as the camera sees it, loaded and unloaded."""

    loaded: FloatArray  # z of the deformed surface [m], shape [height, width]
    rest: FloatArray  # z of the unloaded surface [m], same shape
    contact: BoolArray  # true where the gap to the indenter is at most the contact gap, same shape


def height_maps(
    surface: SurfaceState,
    geometry: CameraGeometry,
    *,
    contact_gap_m: float = TOUCHING_M,
    pad: Pad | None = None,
) -> HeightMaps:
    """Rasterise the loaded and the unloaded surface at the image's resolution.

    Heights are interpolated with continuous slope over the facets, then bounded by the indenter:
    in the contact patch the gel is the surface of what lies within the solver's gap of the
    indenter, from where depth counts, and no pixel lies above it.

    Args:
        contact_gap_m: Largest gap to the indenter that counts as touching [m]; not less than what
            the contact solver leaves.
        pad: Whose domed top the nodes in the middle of its chords are put back onto; None takes
            the mesh for the pad.

    Raises:
        ConfigError: The mesh covers no pixel, at rest or deformed.
    """
    device = Device("cpu")
    drawing = SurfaceHeights(
        surface.top,
        surface.indenter,
        geometry,
        standoff_m=surface.standoff_m,
        contact_gap_m=gap_left(contact_gap_m, surface.standoff_m),
        pad=pad,
    )
    loaded, contact = drawing.maps(
        device.array(surface.positions[None], wp.vec3d),
        device.array(surface.indenter_position[None], wp.vec3d),
        device.array(surface.indenter_rotation[None], wp.mat33d),
    )
    shape, found = (geometry.height, geometry.width), (loaded, drawing.rest_m, contact)
    height, rest, touched = (each.numpy().reshape(shape) for each in found)
    if np.isnan(height).any():
        raise ConfigError(
            "the deformed surface covers no pixel, though the unloaded one does",
            remedy="check that the press ended with finite positions in the pad's frame",
        )
    return HeightMaps(loaded=height, rest=rest, contact=touched > 0)


def gap_left(contact_gap_m: float, standoff_m: float) -> float:
    """Return the largest gap that counts as touching, to what lies within the solver's gap [m]."""
    return max(contact_gap_m - standoff_m, _GAP_SHARE * standoff_m)


class SurfaceHeights:
    """Draws heights per pixel of surfaces that stand side by side on a device.

    Everything is launched without waiting, and no array is made after the first: a CUDA graph can
    hold it.

    Args:
        standoff_m: How far off the indenter the gel lies where it touches [m]: what lies within
            that of it bounds the gel.
        contact_gap_m: Largest gap between gel and what bounds it that counts as touching [m].
        pad: As for ``height_maps``.

    Attributes:
        rest_m: Height of the unloaded surface [m], Warp float64, shape [height * width].
    """

    def __init__(
        self,
        top: TopSurface,
        indenter: Indenter | IndenterSet,
        geometry: CameraGeometry,
        *,
        count: int = 1,
        standoff_m: float = 0.0,
        contact_gap_m: float,
        pad: Pad | None = None,
        device: str = "cpu",
    ) -> None:
        self._count, self._device = count, Device(device)
        self._size = (geometry.height, geometry.width)
        towards = geometry.direction_matrix
        self._view = filled(
            by_pixel.View,
            columns=geometry.width,
            rows=geometry.height,
            centre=wp.vec2d(geometry.centre_x_px, geometry.centre_y_px),
            towards=wp.mat22d(*towards.reshape(-1)),
            back=wp.mat22d(*np.linalg.inv(towards).reshape(-1)),
        )
        bound: Indenter | IndenterSet
        if isinstance(indenter, IndenterSet):
            bodies = tuple(grown(body, standoff_m) for body in indenter.bodies)
            rounding_m = indenter.rounding_m + standoff_m
            bound = replace(indenter, bodies=bodies, rounding_m=rounding_m)
        else:
            bound = grown(indenter, standoff_m)
        self._body = body_of(bound, device=device)
        self._is_quadratic = top.faces.shape[1] == 6
        # What each node lies below the pad's top at rest: edges are chords of a dome.
        lifts = np.zeros(len(top.rest))
        if pad is not None:
            lifts = pad.height_at(top.rest[:, 0], top.rest[:, 1]) - top.rest[:, 2]
            lifts[~np.isfinite(lifts)] = 0.0
        self._take_tables(top, lifts, standoff=standoff_m, gap=contact_gap_m)
        gel, (rows, columns) = self._gel, self._size
        nodes, pixels = len(gel.sources) + _length(gel.face), rows * columns
        drawn = dict.fromkeys(("heights", "pressed"), (count, pixels))
        others = {"steep": (count, len(gel.faces)), "rest": (pixels,)}
        self._canvas = self._device.zeroed(kernels.Canvas, (count, nodes), **drawn, **others)
        empty = self._device.empty
        self._no_dent: Any = empty((0, 0, 0), wp.float32)
        self._no_map = empty((0, 0), wp.float64), empty((0, 0), wp.uint8)
        self.rest_m: Any = self._canvas.rest
        self._draw_rest(top)

    def dents(self, positions: Any, tips: Any, rotations: Any, dent_out: Any) -> None:
        """Draw unloaded minus loaded height [m].

        Args:
            positions: Nodes [m], vec3d, shape [count, node_count].
            tips: The indenter's [m], vec3d, shape [count].
            rotations: Indenter frame to pad frame, mat33d, shape [count].
            dent_out: float32, shape [count, height, width].
        """
        self._draw(positions, tips, rotations, [dent_out, *self._no_map])

    def maps(self, positions: Any, tips: Any, rotations: Any) -> tuple[Any, Any]:
        """Return heights [m], float64, and touch, uint8, [count, height * width]; see ``dents``."""
        pixels = (self._count, self._size[0] * self._size[1])
        loaded, contact = (self._device.empty(pixels, kind) for kind in (wp.float64, wp.uint8))
        self._draw(positions, tips, rotations, [self._no_dent, loaded, contact])
        return loaded, contact

    def _take_tables(self, top: TopSurface, lifts: FloatArray, **lengths_m: float) -> None:
        tables: dict[str, Any] = {"sources": top.sources, "signs": top.signs, "faces": top.faces}
        tables |= {"lifts": lifts, "parts": top.faces, "facets": [[0, 1, 2]]}
        axis = top.mesh_axis_m
        if self._is_quadratic:
            tables |= cut_tables(top.faces, len(top.rest)) | {"facets": QUARTERS}
            tables |= {} if axis is None else round_rings(top.rest, top.faces, axis)
        middle = wp.vec2d(*(axis or (0.0, 0.0)))
        self._gel = self._device.tables(kernels.Gel, tables, axis=middle, **lengths_m)

    def _draw_rest(self, top: TopSurface) -> None:
        """Draw the unloaded surface as it is, neither round nor cut, far from the indenter."""
        device, canvas = self._device, self._canvas
        nodes = np.zeros((1, top.sources.max() + 1, 3))
        nodes[0, top.sources] = top.rest * top.signs
        taken = [self._gel, device.array(nodes, wp.vec3d)]
        device.launch(kernels.take_nodes, (1, len(top.rest)), taken, [canvas])
        self._draw_nodes(1)
        if canvas.heights.numpy()[0].min() >= by_pixel.BARE_M:
            raise ConfigError(
                f"the gel's surface covers none of the {self._size[1]} x {self._size[0]} pixels",
                remedy="check the camera's centre and mm per pixel, and that the mesh is in metres",
            )
        far = poses_at(np.array([[0.0, 0.0, _FAR_M]]), np.eye(3)[None], device)
        out = self.rest_m.reshape((1, -1)), device.empty((1, len(self.rest_m)), wp.uint8)
        self._bound(1, far, [self._no_dent, *out])

    def _draw(self, positions: Any, tips: Any, rotations: Any, outputs: list[Any]) -> None:
        count, gel, canvas, launch = self._count, self._gel, self._canvas, self._device.launch
        poses = filled(Poses, tips=tips, rotations=rotations)
        launch(kernels.take_nodes, (count, len(gel.sources)), [gel, positions], [canvas])
        if _length(gel.on_rays):
            launch(kernels.round_nodes, (count, *gel.on_rays.shape), [gel], [canvas])
        if self._is_quadratic:
            launch(kernels.mark_steep, canvas.steep.shape, [gel], [canvas])
            launch(kernels.add_nodes, (count, len(gel.face)), [gel], [canvas])
        launch(kernels.close_gaps, canvas.nodes.shape, [gel, self._body, poses], [canvas])
        self._draw_nodes(count)
        self._bound(count, poses, outputs)

    def _draw_nodes(self, count: int) -> None:
        """Find slopes at the nodes of the first surfaces, and draw their facets."""
        gel, canvas, launch = self._gel, self._canvas, self._device.launch
        canvas.sums.zero_()
        launch(kernels.add_slopes, (count, len(gel.parts)), [gel], [canvas])
        canvas.heights.fill_(float(by_pixel.BARE_M))
        canvas.pressed.zero_()
        faces, parts, facets = len(gel.faces), len(gel.parts), len(gel.facets)
        whole = _GPU_LANES if self._device.is_gpu else 1
        for first, end, lanes in (0, faces, whole), (faces, parts, 1):
            shape = (count, (end - first) * facets, lanes)
            launch(by_pixel.draw_facets, shape, [gel, self._view, first, lanes], [canvas])

    def _bound(self, count: int, poses: Any, outputs: list[Any]) -> None:
        for by_columns in (True, False):
            lines = (count, self._size[int(by_columns)])
            self._device.launch(by_pixel.fill_bare, lines, [self._view, by_columns], [self._canvas])
        inputs = [self._gel, self._view, self._body, poses, self._canvas]
        self._device.launch(by_pixel.bound_heights, (count, *self._size), inputs, outputs)


def _length(table: Any) -> int:
    """Return the length of a table, which a mesh that calls for none has not."""
    return 0 if table is None else len(table)


_SAME_RADIUS_M = 1e-9
_SAME_ANGLE_RAD = 1e-6
_SECTORS_MIN = 4


def round_rings(
    rest: FloatArray, faces: IntArray, axis_m: tuple[float, float]
) -> dict[str, AnyArray]:
    """Return what draws circles of a revolved mesh smooth, as tables of ``slope_kernel.Gel``.

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
    """Yield the complete rings' nodes on the rays between sectors, and in the middle of sectors.

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

    As ``values`` and ``straight`` of ``slope_kernel.Gel``, of 45 places, and as the places of the
    parts' nodes, shape [16, 6].
    """
    places = list(_FACE_NODES)
    unit = np.eye(3, dtype=np.int64)
    for a, b in FACE_EDGES:
        on_edge = (_EIGHTHS * unit[a] + step * (unit[b] - unit[a]) for step in _ON_EDGE)
        places += [tuple(place.tolist()) for place in on_edge]
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
    corners = faces[:, :3]
    edge = edges_of(corners, FACE_EDGES)[1].reshape(-1)
    order, uses = np.argsort(edge, kind="stable"), np.bincount(edge)
    first, last = order[np.cumsum(uses) - uses], order[np.cumsum(uses) - 1]
    other = np.where(np.arange(len(edge)) == first[edge], last[edge], first[edge])
    across = np.where(uses[edge] == 2, other // 3, -1).reshape(-1, 3)
    count, steps = len(_ON_EDGE), np.arange(len(_ON_EDGE))
    forward = (corners < np.roll(corners, -1, axis=1)).reshape(-1, 1)
    on_edges = count * edge[:, None] + np.where(forward, steps, steps[::-1])
    values, straight, parts = cut_face()
    inner = len(values) - 6 - 3 * count
    own = count * len(first) + np.arange(len(faces) * inner).reshape(-1, inner)
    added = np.concatenate([on_edges.reshape(-1, 3 * count), own], axis=1)
    face, place = np.divmod(np.unique(added, return_index=True)[1], added.shape[1])
    beside = np.column_stack([across, np.full(len(faces), -1)])[face, np.minimum(place // count, 3)]
    nodes = np.concatenate([faces, node_count + added], axis=1)
    parts = np.concatenate([faces, nodes[:, parts].reshape(-1, 6)])
    cut: dict[str, AnyArray] = {"parts": parts, "values": values, "straight": straight}
    return cut | {"across": across, "face": face, "beside": beside, "place": 6 + place}
