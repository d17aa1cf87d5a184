"""The mesh of a sensor's pad that any indenter may press anywhere: fine all over its surface."""

from __future__ import annotations

from dataclasses import replace

from sim.mesh.refinement import bisected_level, brick_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh
from sim.scene.pad import BoxPad
from tacauchy_rig.core.arrays import FloatArray

# Edge length gained per depth below the surface, and the longest over the pad's height.
_SLOPE, _COARSE_SHARE = 0.5, 1.0


def sensor_mesh(pad: BoxPad, *, edge_m: float) -> TetMesh:
    """Mesh a box, flat or domed, of one material.

    Args:
        edge_m: Edge length at the surface [m]; a quadratic element has nodes at half of it.

    Raises:
        ConfigError: It asks for more tetrahedra than can be solved for.
    """
    coarse_m = max(edge_m, _COARSE_SHARE * pad.height_m)

    def size_at(points: FloatArray) -> FloatArray:
        depth = pad.height_at(points[:, 0], points[:, 1]) - points[:, 2]
        return (edge_m + _SLOPE * depth).clip(max=coarse_m)

    base = brick_mesh(pad, spacing_m=coarse_m, symmetry=MirrorSymmetry())
    mesh = bisected_level(base, pad, size_at)
    return replace(mesh, name=f"sensor, edges of {edge_m * 1e3:.3g} mm")
