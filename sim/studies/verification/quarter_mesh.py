"""A quarter of a pad under a body of triangles that two planes mirror.

With the edge lengths of a preset's footprint mesh and a quarter of its unknowns, preset
``reference`` takes minutes in place of hours.
"""

from __future__ import annotations

from dataclasses import replace

from sim.effects.footprint_presets import refined_under, scene_footprint
from sim.effects.mesh_choice import footprint_depth
from sim.mesh.graded_plane import Grading
from sim.mesh.revolved import revolved_mesh
from sim.mesh.tet_mesh import TetMesh
from sim.scene.pad import ParametricPad
from sim.scene.scene import Scene

_COARSE = Grading(start_m=0.0, end_m=1e-3, size_m=2e-3, growth=2.5, size_max_m=2.5e-3)
_SECTORS = 16


def quarter_mesh(scene: Scene, pad: ParametricPad) -> TetMesh:
    """Mesh the quarter x >= 0, y >= 0 of a scene's pad as finely as its footprint mesh would be.

    Args:
        scene: A press in the middle, of a body that the planes x = 0 and y = 0 mirror.
        pad: The scene's.

    Raises:
        ConfigError: An element became too flat.
    """
    base = revolved_mesh(
        pad, _COARSE, centre_m=(0.0, 0.0), sector_count=_SECTORS, name="a coarse quarter"
    )
    touched = scene_footprint(scene, depth_m=footprint_depth(scene))
    return replace(refined_under(scene, base, touched), axis_m=None)
