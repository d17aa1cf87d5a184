"""How fine each preset is around a footprint, and the mesh that a scene gets by that."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.mesh_choice import has_brick, mesh_depth
from sim.mesh.footprint import Footprint, footprint, sizing_field
from sim.mesh.refinement import bisected_level, brick_mesh, with_rim_fitted, with_top_fitted
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh, mesh_key, refuse_flat, stored_mesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.indenter import Cylinder, TurnedIndenter, tilted
from sim.scene.material import interface_shares
from sim.scene.pad import BoxPad, Pad
from sim.scene.scene import Preset, Scene
from tacauchy_rig.core.errors import ConfigError

_SPACING_M = 0.8e-3
_COARSE_M = 2.5e-3
_EPSILON_R = 1e-3
_STOP_ENERGY = 10.0
_DIHEDRAL_MIN_RAD = math.radians(2.0)
_RIM_REACH_SHARE = 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class FootprintResolution:
    """A footprint mesh's numbers.

    Attributes:
        edge_share: Edge length at a sharp edge of the contact over the radius of the disc of the
            same area.
        inside_share: Largest edge length under the contact over that radius.
        fillet_share: Largest edge length at a rounded rim over its fillet.
        growth: Ratio of neighbouring edge lengths away from there.
        coarse_m: Largest edge length [m].
    """

    edge_share: float
    inside_share: float
    fillet_share: float
    growth: float
    coarse_m: float = _COARSE_M


FOOTPRINT_RESOLUTIONS = {
    Preset.FAST: FootprintResolution(
        edge_share=0.06, inside_share=0.40, fillet_share=1.5, growth=3.0, coarse_m=5e-3
    ),
    Preset.BALANCED: FootprintResolution(
        edge_share=0.06, inside_share=0.30, fillet_share=1.0, growth=2.2
    ),
    Preset.ACCURATE: FootprintResolution(
        edge_share=0.03, inside_share=0.20, fillet_share=0.5, growth=1.9
    ),
    Preset.REFERENCE: FootprintResolution(
        edge_share=0.02, inside_share=0.14, fillet_share=0.5, growth=1.7
    ),
}

# Preset fast of a light scene.
FOOTPRINT_LIGHT = FootprintResolution(
    edge_share=0.20, inside_share=0.40, fillet_share=1.5, growth=2.5, coarse_m=5e-3
)


def footprint_mesh(
    scene: Scene, *, symmetry: MirrorSymmetry | None = None, refinement: float = 1.0
) -> TetMesh:
    """Return a mesh of the pad, fine where a scene's indenter touches.

    It refines a regular mesh of a box of one material, or else a coarse one by fTetWild, which is
    made once and kept.

    Args:
        symmetry: By which a part of a box stands for the whole; None meshes the whole.
        refinement: Make every edge this many times shorter.

    Raises:
        ConfigError: The indenter stands beside the pad, fTetWild cannot fill it as asked, or an
            element became too flat.
    """
    pad, resolution = scene.pad, FOOTPRINT_RESOLUTIONS[scene.preset]
    if scene.is_light:
        resolution = FOOTPRINT_LIGHT
    # Before fTetWild is asked: an indenter beside the pad needs no mesh.
    touched = _scene_footprint(scene, depth_m=mesh_depth(scene))
    coarse_m = _coarse_m(scene, resolution)
    if isinstance(pad, BoxPad) and has_brick(scene):
        base = brick_mesh(pad, spacing_m=coarse_m, symmetry=symmetry or MirrorSymmetry())
    else:
        base = _base_mesh(scene)
    edge_m = resolution.edge_share * touched.radius_m
    if isinstance(scene.indenter, Cylinder) and scene.indenter.fillet_m > 0.0:
        edge_m = min(edge_m, resolution.fillet_share * scene.indenter.fillet_m)
    size_at = sizing_field(
        touched,
        edge_m=edge_m / refinement,
        inside_m=resolution.inside_share * touched.radius_m / refinement,
        slope=(1.0 - 1.0 / resolution.growth) / refinement,
        coarse_m=coarse_m / refinement,
    )
    reach_m = 2.0 * (scene.tetwild.epsilon_r or _EPSILON_R) * diagonal(pad)
    fitted = with_top_fitted(bisected_level(base, pad, size_at), pad, reach_m=reach_m)
    rim_reach_m = _RIM_REACH_SHARE * edge_m / refinement
    fitted = with_rim_fitted(fitted, pad, touched.rim, reach_m=rim_reach_m)
    mesh = replace(fitted, name=f"footprint, {scene.preset.value}, on {base.name}")
    refuse_flat(mesh, scene.tetwild.dihedral_min_rad or _DIHEDRAL_MIN_RAD)
    return mesh


def _base_mesh(scene: Scene) -> TetMesh:
    """Return the pad filled by fTetWild with coarse tetrahedra; made once and kept."""
    shares = interface_shares(scene.layers)
    sizing = WildSizing(
        fine_m=_SPACING_M,
        coarse_m=_coarse_m(scene, FOOTPRINT_RESOLUTIONS[Preset.BALANCED]),
        envelope_share=scene.tetwild.epsilon_r or _EPSILON_R,
        stop_energy=scene.tetwild.stop_energy or _STOP_ENERGY,
    )
    key = mesh_key(scene.pad, sizing, shares)

    def made() -> TetMesh:
        name = f"fTetWild, {key}"
        return wild_mesh(scene.pad, sizing, name=name, interface_shares=shares, graded=False)

    return stored_mesh("base", key, made)


def _scene_footprint(scene: Scene, *, depth_m: float) -> Footprint:
    """Return where a scene's indenter touches the pad, before it is carried along and after.

    Raises:
        ConfigError: It comes down beside the pad.
    """
    turned = TurnedIndenter(indenter=scene.indenter, rotation=tilted(*scene.motion.tilt_rad))
    start = footprint(scene.pad, turned, centre_m=scene.centre_m, depth_m=depth_m)
    if not any(scene.motion.shift_m):
        return start
    x, y = np.array(scene.centre_m) + np.array(scene.motion.shift_m)
    try:
        return start.joined(footprint(scene.pad, turned, centre_m=(x, y), depth_m=depth_m))
    except ConfigError:
        # It is carried off the pad, where it touches nothing.
        return start


def _coarse_m(scene: Scene, resolution: FootprintResolution) -> float:
    asked = scene.tetwild.l_r
    return resolution.coarse_m if asked is None else asked * diagonal(scene.pad)


def diagonal(pad: Pad) -> float:
    """Return the diagonal of a pad's bounding box [m]."""
    half_x, half_y = pad.half_extents()
    return math.hypot(2.0 * half_x, 2.0 * half_y, pad.height_m)
