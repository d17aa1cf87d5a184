"""Radius that a sharp rim or a pointed tip is given, from the mesh's edges there."""

from dataclasses import replace

from sim.effects.depth_and_inertia_scales import expected_depth
from sim.effects.mesh_choice import mesh_depth, sharp_edge_m
from sim.effects.presets import finest_edge_m
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter
from sim.scene.scene import Preset, Scene

# Of an edge at a sharp rim, and of the depth: radius that the rim is given. A mesh follows no
# corner, and what it catches of one hangs on chance: F_z of a 5 mm punch, 0.5 mm deep, on three
# edges a tenth apart is 3.11, 3.08 and 3.12 N without, 2.99, 3.01 and 2.98 N with a quarter of an
# edge, and tends to 2.986 N. Half an edge is 1 to 2 % too soft where the depth is less.
_RIM_SHARE = 0.25
# Of the depth: as much of a pointed tip may be cut off by that.
_BLUNTED_SHARE = 0.05


def regularised_indenter(scene: Scene, *, refinement: float = 1.0) -> Indenter:
    """Return the mesh-regularised indenter: sharp edges are rounded by a share of an edge.

    Args:
        refinement: Every edge is this many times shorter.
    """
    indenter = scene.indenter
    if scene.preset is Preset.PAPER:
        return indenter
    if isinstance(indenter, MeshIndenter):
        depth_m = mesh_depth(scene)
        radius_m = _RIM_SHARE * min(sharp_edge_m(scene) / refinement, depth_m)
        rounded = indenter.with_edges(radius_m)
        blunt = rounded.blunted_m / (_BLUNTED_SHARE * depth_m)
        return rounded if blunt <= 1.0 else indenter.with_edges(radius_m / blunt)
    if not isinstance(indenter, Cylinder) or indenter.fillet_m > 0.0:
        return indenter
    edge_m = finest_edge_m(scene) / (scene.refinement * refinement)
    return replace(indenter, fillet_m=_RIM_SHARE * min(edge_m, expected_depth(scene)))
