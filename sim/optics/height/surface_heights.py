"""Heights of many deformed surfaces of one gel, from nodal positions, on one device."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.device import Device, filled
from sim.fields.surface import TopSurface
from sim.mesh.elements import QUARTERS
from sim.optics.camera_geometry import CameraGeometry
from sim.optics.height.facet_kernel import BARE_M, View, bound_heights, draw_facets, find_covered
from sim.optics.height.node_kernel import (
    Cuts,
    Follower,
    Rings,
    add_nodes,
    add_slopes,
    close_gaps,
    mark_edges,
    mark_steep,
    place_on_rings,
    round_nodes,
    take_nodes,
)
from sim.optics.height.rings import round_rings
from sim.optics.height.slope_fit_kernel import fit_slopes, two_rings
from sim.optics.height.steep_faces import added_nodes, cut_face
from sim.optics.height.underside_kernel import Poses, solid_of
from sim.scene.indenter import Indenter, grown
from sim.scene.pad import Pad
from tacauchy_rig.errors import ConfigError

# Threads of a facet on a GPU; a face seen from near covers thousands of pixels.
_GPU_LANES = 32
# Above all gel [m].
_FAR_M = 1.0


class SurfaceHeights:
    """Draws heights per pixel of surfaces that stand side by side on a device.

    The deformed positions are drawn, so material that slid sideways is where it is. Everything is
    launched without waiting, and no array is made after the first: a CUDA graph can hold it.

    Args:
        top: What of the gel is seen, at rest.
        indenter: The body, or what of it bounds the gel.
        geometry: Pixels.
        count: Surfaces.
        standoff_m: How far off the indenter the gel lies where it touches [m]: what lies within
            that of it is what bounds the gel.
        contact_gap_m: Largest gap between gel and what bounds it that counts as touching [m].
        pad: Whose top the mesh stands for; None takes the mesh for the pad.
        device: Warp's name of it.

    Attributes:
        rest_m: Height of the unloaded surface [m], a Warp array of float64, shape
            [height * width].

    Raises:
        ConfigError: The mesh covers no pixel.
    """

    def __init__(
        self,
        top: TopSurface,
        indenter: Indenter,
        geometry: CameraGeometry,
        *,
        count: int = 1,
        standoff_m: float = 0.0,
        contact_gap_m: float,
        pad: Pad | None = None,
        device: str = "cpu",
    ) -> None:
        self._count, self._device = count, Device(device)
        self._standoff_m, self._gap_m = standoff_m, wp.float64(contact_gap_m)
        self._size = (geometry.height, geometry.width)
        self._view = _view(geometry)
        self._body, self._body_kept = solid_of(grown(indenter, standoff_m), device)
        self._is_quadratic = top.faces.shape[1] == 6
        lifts = np.zeros(len(top.rest)) if pad is None else _lifts(top.rest, pad)
        self._take_tables(top, lifts)
        self._make_room()
        empty = self._device.empty
        self._no_dent: Any = empty((0, 0, 0), wp.float32)
        self._no_map = empty((0, 0), wp.float64), empty((0, 0), wp.uint8)
        self.rest_m: Any = empty((self._size[0] * self._size[1],), wp.float64)
        self._draw_rest(top)

    def dents(self, positions: Any, tips: Any, rotations: Any, dent_out: Any) -> None:
        """Draw unloaded minus loaded height [m].

        Args:
            positions: Nodes [m], vec3d, shape [count, node_count].
            tips: The indenter's [m], vec3d, shape [count].
            rotations: Indenter frame to pad frame, mat33d, shape [count].
            dent_out: float32, shape [count, height, width].
        """
        poses = _poses(tips, rotations, self._standoff_m)
        self._draw(positions, poses)
        self._bound(self._count, poses, [dent_out, *self._no_map])

    def maps(self, positions: Any, tips: Any, rotations: Any) -> tuple[Any, Any]:
        """Return heights [m], float64, and where the gel touches, uint8, [count, height * width].

        Args are those of ``dents``.
        """
        pixels = (self._count, self._size[0] * self._size[1])
        loaded, contact = (self._device.empty(pixels, kind) for kind in (wp.float64, wp.uint8))
        poses = _poses(tips, rotations, self._standoff_m)
        self._draw(positions, poses)
        self._bound(self._count, poses, [self._no_dent, loaded, contact])
        return loaded, contact

    def _take_tables(self, top: TopSurface, lifts: FloatArray) -> None:
        device, node_count = self._device, len(top.rest)
        parts, facets = top.faces, np.array([[0, 1, 2]])
        self._cuts, self._rings, self._neighbours = Cuts(), None, None
        self._added_count = 0
        if self._is_quadratic:
            cut, added = cut_face(), added_nodes(top.faces, node_count)
            parts, facets = np.concatenate([top.faces, added.parts]), np.array(QUARTERS)
            self._added_count = len(added.face)
            self._cuts = device.tables(Cuts, cut, added)
        else:
            rings = two_rings(parts, node_count)
            self._neighbours = [device.array(table, wp.int32) for table in rings]
        if self._is_quadratic and top.mesh_axis_m is not None:
            made, (x, y) = round_rings(top.rest, top.faces, top.mesh_axis_m), top.mesh_axis_m
            self._rings = device.tables(Rings, made, x=x, y=y) if len(made.on_rays) else None
        self._follower = device.tables(
            Follower,
            top,
            lifts=device.array(lifts, wp.float64),
            parts=device.array(parts, wp.int32),
            facets=device.array(facets, wp.int32),
        )
        self._node_count, self._face_count = node_count, len(top.faces)
        self._part_count, self._facet_count = len(parts), len(facets)

    def _make_room(self) -> None:
        count, nodes = self._count, self._node_count + self._added_count
        pixels, columns = self._size[0] * self._size[1], self._size[1]
        zeros = self._device.zeros
        self._nodes: Any = zeros((count, nodes), wp.vec3d)
        self._slopes: Any = zeros((count, nodes), wp.vec2d)
        self._sums: Any = zeros((count, nodes), wp.vec3d)
        self._states: Any = zeros((count, nodes), wp.int32)
        self._marks: Any = zeros((count, nodes, 2), wp.int32)
        self._steep: Any = zeros((count, self._face_count), wp.int32)
        self._heights: Any = zeros((count, pixels), wp.float64)
        self._pressed: Any = zeros((count, pixels), wp.uint8)
        self._nearest: Any = zeros((count, pixels), wp.int16)
        self._whole: Any = zeros((count, columns), wp.uint8)
        if self._rings is not None:
            self._places: Any = zeros((count, len(self._rings.between)), wp.vec3d)

    def _draw_rest(self, top: TopSurface) -> None:
        """Draw the unloaded surface as it is, neither round nor cut, far from the indenter."""
        device = self._device
        nodes = np.zeros((1, top.sources.max() + 1, 3))
        nodes[0, top.sources] = top.rest * top.signs
        taken = [self._follower, device.vectors(nodes)]
        device.launch(take_nodes, (1, self._node_count), taken, [self._nodes])
        self._draw_nodes(1)
        if self._heights.numpy()[0].min() >= BARE_M:
            raise ConfigError(
                f"the gel's surface covers none of the {self._size[1]} x {self._size[0]} pixels",
                remedy="check the camera's centre and mm per pixel, and that the mesh is in metres",
            )
        far = device.vectors(np.array([[0.0, 0.0, _FAR_M]]))
        upright = device.array(np.eye(3)[None], wp.mat33d)
        out = self.rest_m.reshape((1, -1)), device.empty((1, len(self.rest_m)), wp.uint8)
        self._bound(1, _poses(far, upright, 0.0), [self._no_dent, *out])

    def _draw(self, positions: Any, poses: Any) -> None:
        """Draw all surfaces, not yet bounded by the indenter."""
        count, follower, launch = self._count, self._follower, self._device.launch
        nodes, steep = self._nodes, self._steep
        launch(take_nodes, (count, self._node_count), [follower, positions], [nodes])
        if self._rings is not None:
            rings, places = self._rings, self._places
            launch(place_on_rings, places.shape, [rings, nodes], [places])
            launch(round_nodes, (count, len(rings.on_rays)), [rings, places], [nodes])
        if self._is_quadratic:
            launch(mark_steep, steep.shape, [follower, nodes], [steep])
            launch(add_nodes, (count, self._added_count), [follower, self._cuts, steep], [nodes])
        touched = [follower, self._cuts, self._body, poses, self._gap_m, steep, nodes]
        launch(close_gaps, nodes.shape, touched, [self._slopes, self._states])
        self._marks.zero_()
        marked = [follower, steep, self._states]
        launch(mark_edges, (count, self._part_count), marked, [self._marks])
        self._draw_nodes(count)

    def _draw_nodes(self, count: int) -> None:
        """Find slopes at the nodes of the first surfaces, and draw their facets."""
        follower, launch = self._follower, self._device.launch
        contact = [self._steep, self._states, self._marks]
        if self._neighbours is None:
            self._sums.zero_()
            added = [follower, *contact, self._nodes]
            launch(add_slopes, (count, self._part_count), added, [self._sums])
        else:
            fitted = [*self._neighbours, *contact[1:], self._nodes]
            launch(fit_slopes, (count, self._node_count), fitted, [self._sums])
        self._heights.fill_(float(BARE_M))
        self._pressed.zero_()
        drawn = [*contact, self._slopes, self._sums, self._nodes]
        whole = _GPU_LANES if self._device.is_gpu else 1
        ends = (0, self._face_count, whole), (self._face_count, self._part_count, 1)
        for first, end, lanes in ends:
            launch(
                draw_facets,
                (count, (end - first) * self._facet_count, lanes),
                [follower, self._view, first, lanes, *drawn],
                [self._heights, self._pressed],
            )
        found = [self._nearest, self._whole]
        launch(find_covered, (count, self._size[1]), [self._view, self._heights], found)

    def _bound(self, count: int, poses: Any, outputs: list[Any]) -> None:
        rest = [self.rest_m, self._heights, self._pressed, self._nearest, self._whole]
        inputs = [self._view, self._body, poses, self._gap_m, *rest]
        self._device.launch(bound_heights, (count, *self._size), inputs, outputs)


def _poses(tips: Any, rotations: Any, away_m: float) -> Any:
    return filled(Poses, tips=tips, rotations=rotations, away_m=away_m)


def _view(geometry: CameraGeometry) -> Any:
    towards = geometry.direction_matrix
    return filled(
        View,
        columns=geometry.width,
        rows=geometry.height,
        centre=wp.vec2d(geometry.centre_x_px, geometry.centre_y_px),
        towards=wp.mat22d(*towards.reshape(-1)),
        back=wp.mat22d(*np.linalg.inv(towards).reshape(-1)),
    )


def _lifts(rest: FloatArray, pad: Pad) -> FloatArray:
    """Return what each node lies below the pad's top at rest [m]; edges are chords of a dome."""
    lift = pad.height_at(rest[:, 0], rest[:, 1]) - rest[:, 2]
    return np.where(np.isfinite(lift), lift, 0.0)
