"""Heights per pixel of deformed surfaces of one gel, from the deformed mesh, on one device."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from sim.contact.indenter_distance import Poses, body_of, poses_at, uploaded_surface
from sim.device import Device, filled
from sim.fields.surface import SurfaceState, TopSurface
from sim.mesh.elements import QUARTERS
from sim.optics.height import node_kernel as kernels
from sim.optics.height.drawn_nodes import cut_tables, round_rings, two_rings
from sim.optics.height.facet_kernel import BARE_M, View, bound_heights, draw_facets
from sim.scene.indenter import Indenter, IndenterSet, MeshIndenter, grown
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import BoolArray, FloatArray
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
        contact_gap_m: Largest gap between gel and indenter that counts as touching [m]; not less
            than the gap that the contact solver leaves.
        pad: Whose top the mesh stands for; edges are chords of a domed top, and the nodes in their
            middles are put back onto it. None takes the mesh for the pad.

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
    shape = geometry.height, geometry.width
    if np.isnan(loaded.numpy()).any():
        raise ConfigError(
            "the deformed surface covers no pixel, though the unloaded one does",
            remedy="check that the press ended with finite positions in the pad's frame",
        )
    return HeightMaps(
        loaded=loaded.numpy().reshape(shape),
        rest=drawing.rest_m.numpy().reshape(shape),
        contact=contact.numpy().reshape(shape) > 0,
    )


def gap_left(contact_gap_m: float, standoff_m: float) -> float:
    """Return the largest gap that counts as touching, to what lies within the solver's gap [m]."""
    return max(contact_gap_m - standoff_m, _GAP_SHARE * standoff_m)


class SurfaceHeights:
    """Draws heights per pixel of surfaces that stand side by side on a device.

    The deformed positions are drawn, so material that slid sideways is where it is. Everything is
    launched without waiting, and no array is made after the first: a CUDA graph can hold it.

    Args:
        top: What of the gel is seen, at rest.
        indenter: The body, or what of it bounds the gel.
        standoff_m: How far off the indenter the gel lies where it touches [m]: what lies within
            that of it is what bounds the gel.
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
        self._view = _view(geometry)
        bound: Indenter | IndenterSet
        if isinstance(indenter, IndenterSet):
            bodies = tuple(grown(body, standoff_m) for body in indenter.bodies)
            rounding_m = indenter.rounding_m + standoff_m
            bound = replace(indenter, bodies=bodies, rounding_m=rounding_m)
        else:
            bound = grown(indenter, standoff_m)
            bodies = (bound,)
        self._body = body_of(bound, device=device)
        # Kernels find a mesh by the place of its tree, which must live as long.
        meshes = [body for body in bodies if isinstance(body, MeshIndenter)]
        self._kept = [uploaded_surface(body, device) for body in meshes]
        self._is_quadratic = top.faces.shape[1] == 6
        lifts = np.zeros(len(top.rest)) if pad is None else _lifts(top.rest, pad)
        self._take_tables(top, lifts, standoff=standoff_m, gap=contact_gap_m)
        self._canvas = self._blank()
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
        poses = filled(Poses, tips=tips, rotations=rotations)
        self._draw(positions, poses)
        self._bound(self._count, poses, [dent_out, *self._no_map])

    def maps(self, positions: Any, tips: Any, rotations: Any) -> tuple[Any, Any]:
        """Return heights [m], float64, and where the gel touches, uint8, [count, height * width].

        Args are those of ``dents``.
        """
        pixels = (self._count, self._size[0] * self._size[1])
        loaded, contact = (self._device.empty(pixels, kind) for kind in (wp.float64, wp.uint8))
        poses = filled(Poses, tips=tips, rotations=rotations)
        self._draw(positions, poses)
        self._bound(self._count, poses, [self._no_dent, loaded, contact])
        return loaded, contact

    def _take_tables(self, top: TopSurface, lifts: FloatArray, **lengths_m: float) -> None:
        tables: dict[str, Any] = {"sources": top.sources, "signs": top.signs, "faces": top.faces}
        tables |= {"lifts": lifts, "parts": top.faces, "facets": [[0, 1, 2]]}
        axis = top.mesh_axis_m
        if self._is_quadratic:
            tables |= cut_tables(top.faces, len(top.rest)) | {"facets": QUARTERS}
            tables |= {} if axis is None else round_rings(top.rest, top.faces, axis)
        else:
            tables |= two_rings(top.faces, len(top.rest))
        middle = wp.vec2d(*(axis or (0.0, 0.0)))
        self._gel = self._device.tables(kernels.Gel, tables, axis=middle, **lengths_m)

    def _blank(self) -> Any:
        """Return room for all that is drawn."""
        gel, count, (rows, columns) = self._gel, self._count, self._size
        nodes, pixels = len(gel.sources) + _length(gel.face), rows * columns
        drawn = dict.fromkeys(("heights", "pressed"), (count, pixels))
        others = {"steep": (count, len(gel.faces)), "covered": (count,), "rest": (pixels,)}
        return self._device.zeroed(kernels.Canvas, (count, nodes), **drawn, **others)

    def _draw_rest(self, top: TopSurface) -> None:
        """Draw the unloaded surface as it is, neither round nor cut, far from the indenter."""
        device, canvas = self._device, self._canvas
        nodes = np.zeros((1, top.sources.max() + 1, 3))
        nodes[0, top.sources] = top.rest * top.signs
        taken = [self._gel, device.array(nodes, wp.vec3d)]
        device.launch(kernels.take_nodes, (1, len(top.rest)), taken, [canvas])
        self._draw_nodes(1)
        if canvas.heights.numpy()[0].min() >= BARE_M:
            raise ConfigError(
                f"the gel's surface covers none of the {self._size[1]} x {self._size[0]} pixels",
                remedy="check the camera's centre and mm per pixel, and that the mesh is in metres",
            )
        far = poses_at(np.array([[0.0, 0.0, _FAR_M]]), np.eye(3)[None], device)
        out = self.rest_m.reshape((1, -1)), device.empty((1, len(self.rest_m)), wp.uint8)
        self._bound(1, far, [self._no_dent, *out])

    def _draw(self, positions: Any, poses: Any) -> None:
        """Draw all surfaces, not yet bounded by the indenter."""
        count, gel, canvas, launch = self._count, self._gel, self._canvas, self._device.launch
        launch(kernels.take_nodes, (count, len(gel.sources)), [gel, positions], [canvas])
        if _length(gel.on_rays):
            launch(kernels.round_nodes, (count, *gel.on_rays.shape), [gel], [canvas])
        if self._is_quadratic:
            launch(kernels.mark_steep, canvas.steep.shape, [gel], [canvas])
            launch(kernels.add_nodes, (count, len(gel.face)), [gel], [canvas])
        launch(kernels.close_gaps, canvas.nodes.shape, [gel, self._body, poses], [canvas])
        launch(kernels.mark_edges, (count, len(gel.parts)), [gel], [canvas])
        self._draw_nodes(count)

    def _draw_nodes(self, count: int) -> None:
        """Find slopes at the nodes of the first surfaces, and draw their facets."""
        gel, canvas, launch = self._gel, self._canvas, self._device.launch
        if self._is_quadratic:
            canvas.sums.zero_()
            launch(kernels.add_slopes, (count, len(gel.parts)), [gel], [canvas])
        else:
            launch(kernels.fit_slopes, (count, len(gel.sources)), [gel], [canvas])
        canvas.heights.fill_(float(BARE_M))
        canvas.pressed.zero_()
        canvas.covered.zero_()
        faces, parts, facets = len(gel.faces), len(gel.parts), len(gel.facets)
        whole = _GPU_LANES if self._device.is_gpu else 1
        for first, end, lanes in (0, faces, whole), (faces, parts, 1):
            shape = (count, (end - first) * facets, lanes)
            launch(draw_facets, shape, [gel, self._view, first, lanes], [canvas])

    def _bound(self, count: int, poses: Any, outputs: list[Any]) -> None:
        inputs = [self._gel, self._view, self._body, poses, self._canvas]
        self._device.launch(bound_heights, (count, *self._size), inputs, outputs)


def _length(table: Any) -> int:
    """Return the length of a table, which a mesh that calls for none has not."""
    return 0 if table is None else len(table)


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
