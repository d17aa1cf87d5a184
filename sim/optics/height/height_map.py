"""Height of the gel's surface per pixel, from the deformed mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.arrays import FloatArray, IntArray
from sim.fields.surface import SurfaceState
from sim.optics.camera_geometry import CameraGeometry
from sim.optics.height.contact import close_contact, corner_slopes, indenter_height
from sim.optics.height.gradient_recovery import node_gradients
from sim.optics.height.rasterise import CloughTocherPatches, rasterise
from sim.optics.height.rings import with_round_rings
from sim.optics.height.steep_faces import with_steep_faces_split
from sim.scene.indenter import grown
from sim.scene.pad import Pad
from tacauchy_rig.errors import ConfigError

# Of the solver's gap: by so much it varies under the indenter.
_GAP_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMaps:
    """The gel as the camera sees it, loaded and unloaded.

    Attributes:
        loaded: z of the deformed surface [m], shape [height, width].
        rest: z of the unloaded surface [m], same shape.
        contact: True where the gap to the indenter is at most the contact gap, same shape.
    """

    loaded: FloatArray
    rest: FloatArray
    contact: NDArray[np.bool_]


def height_maps(
    surface: SurfaceState,
    geometry: CameraGeometry,
    *,
    contact_gap_m: float = 6e-6,
    pad: Pad | None = None,
) -> HeightMaps:
    """Rasterise the loaded and the unloaded surface at the image's resolution.

    The deformed positions are rasterised, so material that slid sideways is drawn where it is.
    Heights are interpolated with continuous slope over the facets, then bounded by the indenter:
    in the contact patch the gel is the surface of what lies within the solver's gap of the
    indenter, from where depth counts, and no pixel lies above it.

    Args:
        surface: Deformed surface and indenter.
        geometry: Pixels.
        contact_gap_m: Largest gap between gel and indenter that counts as touching [m]; not less
            than the gap that the contact solver leaves.
        pad: Whose top the mesh stands for; edges are chords of a domed top, and the nodes in their
            middles are put back onto it. None takes the mesh for the pad.

    Raises:
        ConfigError: The mesh covers no pixel.
    """
    if pad is not None:
        surface = _on_top(surface, pad)
    contact_gap_m = max(contact_gap_m - surface.standoff_m, _GAP_SHARE * surface.standoff_m)
    rest = interpolate_height(
        surface.positions_rest, surface.triangles, geometry, triangles6=surface.triangles6
    )
    surface = with_steep_faces_split(with_round_rings(_bounded(surface)))
    ceiling = indenter_height(surface, *geometry.pad_grid())
    nodes, gradients, touching = close_contact(surface, contact_gap_m)
    corner_gradients = corner_slopes(nodes, surface.triangles, gradients, touching)
    pressed = np.all(touching[surface.triangles], axis=1, keepdims=True)[:, 0]
    foot = np.any(touching[surface.triangles], axis=1, keepdims=True)[:, 0]
    floor = np.where(foot, nodes[surface.triangles, 2].min(axis=1), -np.inf)
    gel, under = _rasterised(nodes, surface.triangles, corner_gradients, pressed, floor, geometry)
    loaded = np.where(under & np.isfinite(ceiling), ceiling, np.minimum(gel, ceiling))
    return HeightMaps(
        loaded=loaded,
        rest=rest,
        contact=np.isfinite(ceiling) & (ceiling - loaded <= contact_gap_m),
    )


def _on_top(surface: SurfaceState, pad: Pad) -> SurfaceState:
    """Lift each node by what it lies below the pad's top at rest."""
    rest = surface.positions_rest
    lift = pad.height_at(rest[:, 0], rest[:, 1]) - rest[:, 2]
    lifted = np.zeros_like(rest)
    lifted[:, 2] = np.where(np.isfinite(lift), lift, 0.0)
    return replace(surface, positions_rest=rest + lifted, positions=surface.positions + lifted)


def _bounded(surface: SurfaceState) -> SurfaceState:
    """Take for the indenter what bounds the gel: all that lies within the solver's gap of it."""
    away = surface.standoff_m * surface.indenter_rotation[:, 2]
    return replace(
        surface,
        indenter=grown(surface.indenter, surface.standoff_m),
        indenter_position=surface.indenter_position - away,
        standoff_m=0.0,
    )


def interpolate_height(
    positions: FloatArray,
    triangles: IntArray,
    geometry: CameraGeometry,
    *,
    triangles6: IntArray | None = None,
) -> FloatArray:
    """Interpolate z of a triangulated surface at every pixel, with continuous slope.

    Pixels beside the mesh take the height of the nearest covered pixel. Where the surface folds
    over itself, the camera, looking along +z, sees the lowest sheet.

    Args:
        positions: Nodes [m], shape [node_count, 3].
        triangles: Facets, shape [facet_count, 3].
        geometry: Pixels.
        triangles6: The quadratic faces that the facets are of, shape [face_count, 6].

    Returns:
        Heights [m], shape [geometry.height, geometry.width].

    Raises:
        ConfigError: The mesh covers no pixel.
    """
    gradients = node_gradients(positions, triangles, triangles6, None)
    free = np.zeros(len(triangles), dtype=np.bool_)
    bottomless = np.full(len(triangles), -np.inf)
    return _rasterised(positions, triangles, gradients[triangles], free, bottomless, geometry)[0]


def _rasterised(
    positions: FloatArray,
    triangles: IntArray,
    corner_gradients: FloatArray,
    pressed: NDArray[np.bool_],
    floor: FloatArray,
    geometry: CameraGeometry,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the height per pixel, and which pixels see one of the pressed facets.

    ``floor`` is the lowest height of each facet [m]: beside the contact the gel only rises, which a
    cubic over a coarse facet may not know.
    """
    corners = positions[triangles]
    pixels = geometry.to_pixels(corners[..., :2])
    cover = rasterise(pixels, height=geometry.height, width=geometry.width)
    if len(cover.pixel) == 0:
        raise ConfigError(
            f"the gel's surface covers none of the {geometry.width} x {geometry.height} pixels",
            remedy="check the camera's centre and mm per pixel, and that the mesh is in metres",
        )
    patches = CloughTocherPatches(corners[..., :2], corners[..., 2], corner_gradients)
    flat = np.full(geometry.width * geometry.height, np.inf)
    heights = np.maximum(patches.evaluate(cover.facet, cover.barycentric), floor[cover.facet])
    np.minimum.at(flat, cover.pixel, heights)
    under = np.zeros(len(flat), dtype=np.bool_)
    under[cover.pixel[pressed[cover.facet]]] = True
    shape = (geometry.height, geometry.width)
    return _extend(flat.reshape(shape)), under.reshape(shape)


def _extend(height: FloatArray) -> FloatArray:
    """Fill uncovered pixels (inf) with the nearest covered one."""
    bare = ~np.isfinite(height)
    if not bare.any():
        return height
    nearest = ndimage.distance_transform_edt(bare, return_distances=False, return_indices=True)
    return np.asarray(height[tuple(nearest)])
