"""The deformed gel surface as the mechanics hands it to the optics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.scene.indenter import Indenter
from tacauchy_rig.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TopSurface:
    """The gel's contact surface at rest, and how its nodes follow those of a model."""

    rest: FloatArray  # nodes at rest [m], shape [node_count, 3]
    # Counter-clockwise seen from +z: linear ones, shape [face_count, 3], or quadratic ones, shape
    # [face_count, 6], corners 0, 1, 2, then the nodes on the edges 01, 12, 20
    faces: IntArray
    sources: IntArray  # node of the model that each node is, or mirrors
    signs: FloatArray  # of its coordinates, shape [node_count, 3]
    # Axis about which the mesh was revolved, x and y [m]; None where it was not
    mesh_axis_m: tuple[float, float] | None = None

    def of(self, nodes: FloatArray) -> FloatArray:
        """Return its nodes from those of the model, such as positions [m], [node_count, 3]."""
        return np.asarray(nodes[self.sources] * self.signs)


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceState:
    """The gel's contact surface at rest and deformed, and the indenter in it.

    The frame is the pad's: x, y centred on the pad, z = 0 at the clamped base, +z towards the
    indenter. Only the top surface is held, not the side walls or the base. Of a quadratic
    element (P2) the mid-edge nodes are nodes like any other.
    """

    positions_rest: FloatArray  # nodes at rest [m], shape [node_count, 3]
    positions: FloatArray  # the same nodes deformed [m], shape [node_count, 3]
    # As ``TopSurface`` has them; quadratic ones are straight-sided at rest, parabolic when deformed
    faces: IntArray
    # The rigid body, or with a wide barrier what lies within d_hat of it; its ``lower_surface(x,
    # y)`` is the height above its own tip
    indenter: Indenter
    # Its tip [m], shape [3]: no point of the gel lies above ``indenter_position[2] +
    # lower_surface(x - indenter_position[0], ...)``, unless by a part of a wide barrier's d_hat
    # where it is pressed hard
    indenter_position: FloatArray
    # Indenter frame to pad frame, shape [3, 3]; identity for a plain press
    indenter_rotation: FloatArray
    # How far off the indenter the gel lies where it touches [m]: the contact distance d_hat, while
    # the indenter is the body itself
    standoff_m: float = 0.0
    # Axis about which the mesh was revolved, x and y [m]; None where it was not
    mesh_axis_m: tuple[float, float] | None = None

    @property
    def top(self) -> TopSurface:
        """The surface at rest, of which this one is its own model."""
        return TopSurface(
            rest=self.positions_rest,
            faces=self.faces,
            sources=np.arange(len(self.positions_rest), dtype=np.int32),
            signs=np.ones_like(self.positions_rest),
            mesh_axis_m=self.mesh_axis_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class IntermediateState:
    """The surface at one force along a press."""

    force_n: float
    depth_m: float
    surface: SurfaceState
    pressure_pa: FloatArray  # contact pressure at the surface's nodes, shape [node_count]
