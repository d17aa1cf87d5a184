"""Height of the gel's surface per pixel, from the deformed mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.arrays import FloatArray, IntArray
from sim.optics.contact_bound import indenter_height, indenter_slope
from sim.optics.geometry import CameraGeometry
from sim.optics.gradient_recovery import nodes_of, recover_gradients
from sim.optics.rasterise import rasterise
from sim.optics.smooth_interpolation import CloughTocherPatches
from sim.surface import SurfaceState
from tacauchy_rig.errors import ConfigError


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
    surface: SurfaceState, geometry: CameraGeometry, *, contact_gap_m: float = 6e-6
) -> HeightMaps:
    """Rasterise the loaded and the unloaded surface at the image's resolution.

    The deformed positions are rasterised, so material that slid sideways is drawn where it is.
    Heights are interpolated with continuous slope over the facets, then bounded by the indenter:
    in the contact patch the gel is the indenter's surface, and no pixel lies above it.

    Args:
        surface: Deformed surface and indenter.
        geometry: Pixels.
        contact_gap_m: Largest gap between gel and indenter that counts as touching [m]; not less
            than the gap that the contact solver leaves.

    Raises:
        ConfigError: The mesh covers no pixel.
    """
    ceiling = indenter_height(surface, *geometry.pad_grid())
    nodes, gradients, touching = _closed_contact(surface, contact_gap_m)
    gel, under = _rasterised(nodes, surface.triangles, gradients, touching, geometry)
    loaded = np.where(under & np.isfinite(ceiling), ceiling, np.minimum(gel, ceiling))
    return HeightMaps(
        loaded=loaded,
        rest=interpolate_height(surface.positions_rest, surface.triangles, geometry),
        contact=np.isfinite(ceiling) & (ceiling - loaded <= contact_gap_m),
    )


def interpolate_height(
    positions: FloatArray, triangles: IntArray, geometry: CameraGeometry
) -> FloatArray:
    """Interpolate z of a triangulated surface at every pixel, with continuous slope.

    Pixels beside the mesh take the height of the nearest covered pixel. Where the surface folds
    over itself, the camera, looking along +z, sees the lowest sheet.

    Args:
        positions: Nodes [m], shape [node_count, 3].
        triangles: Facets, shape [facet_count, 3].
        geometry: Pixels.

    Returns:
        Heights [m], shape [geometry.height, geometry.width].

    Raises:
        ConfigError: The mesh covers no pixel.
    """
    gradients = recover_gradients(positions, triangles)
    free = np.zeros(len(positions), dtype=np.bool_)
    return _rasterised(positions, triangles, gradients, free, geometry)[0]


def _closed_contact(
    surface: SurfaceState, contact_gap_m: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return nodes with the solver's gap closed, the slope at each, and which touch.

    Under a smooth part of the indenter the gel has the indenter's slope; at its rim, where nodes
    next to a touching one lie beside the indenter, that of the free gel.
    """
    nodes = surface.positions.copy()
    ceiling = indenter_height(surface, nodes[:, 0], nodes[:, 1])
    touching = ceiling - nodes[:, 2] <= contact_gap_m
    nodes[touching, 2] = ceiling[touching]
    gradients = recover_gradients(nodes, surface.triangles, touching=touching)
    half_covered = ~np.isfinite(ceiling)[surface.triangles].all(axis=1)
    at_rim = nodes_of(surface.triangles[half_covered], len(nodes))
    slope = indenter_slope(surface, nodes[:, 0], nodes[:, 1])
    follows = touching & ~at_rim & np.isfinite(slope).all(axis=1)
    return nodes, np.where(follows[:, None], slope, gradients), touching


def _rasterised(
    positions: FloatArray,
    triangles: IntArray,
    gradients: FloatArray,
    touching: NDArray[np.bool_],
    geometry: CameraGeometry,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the height per pixel and which pixels see a facet that touches with every node."""
    pixels = geometry.to_pixels(positions[:, :2])
    cover = rasterise(pixels[triangles], height=geometry.height, width=geometry.width)
    if len(cover.pixel) == 0:
        raise ConfigError(
            f"the gel's surface covers none of the {geometry.width} x {geometry.height} pixels",
            remedy="check the camera's centre and mm per pixel, and that the mesh is in metres",
        )
    patches = CloughTocherPatches(
        positions[triangles][..., :2], positions[triangles][..., 2], gradients[triangles]
    )
    flat = np.full(geometry.width * geometry.height, np.inf)
    np.minimum.at(flat, cover.pixel, patches.evaluate(cover.facet, cover.barycentric))
    under = np.zeros(len(flat), dtype=np.bool_)
    touches_whole = np.all(touching[triangles], axis=1, keepdims=True)[:, 0]
    under[cover.pixel[touches_whole[cover.facet]]] = True
    shape = (geometry.height, geometry.width)
    return _extend(flat.reshape(shape)), under.reshape(shape)


def _extend(height: FloatArray) -> FloatArray:
    """Fill uncovered pixels (inf) with the nearest covered one."""
    bare = ~np.isfinite(height)
    if not bare.any():
        return height
    nearest = ndimage.distance_transform_edt(bare, return_distances=False, return_indices=True)
    return np.asarray(height[tuple(nearest)])
