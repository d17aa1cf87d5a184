"""Height of the gel's surface per pixel, from the deformed mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.device import Device
from sim.fields.surface import SurfaceState
from sim.optics.height.surface_heights import SurfaceHeights
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.errors import ConfigError

# What touches, a little more than the gap that narrow barriers leave.
TOUCHING_M = 6e-6
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
    contact_gap_m: float = TOUCHING_M,
    pad: Pad | None = None,
) -> HeightMaps:
    """Rasterise the loaded and the unloaded surface at the image's resolution.

    The deformed positions are rasterised, so material that slid sideways is drawn where it is.
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
