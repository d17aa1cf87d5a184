"""Which kind of mesh a scene gets, and the meshes that are fine around a footprint.

Revolved meshes serve a pad with a known outline under an indenter that is round seen from above and
stands upright, its edge on the pad all around (docs/explanation/meshes.md).
"""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache, partial

import numpy as np

from sim.effects.depth_and_inertia_scales import contact_radius, expected_depth
from sim.mesh.brick_refinement import bisected_level, brick_mesh, with_rim_fitted, with_top_fitted
from sim.mesh.cached_tet_mesh import TetMesh, mesh_key, refuse_flat, stored_mesh
from sim.mesh.footprint_sizing import Footprint, footprint, sizing_field
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere, TurnedIndenter, tilted
from sim.scene.material import interface_shares
from sim.scene.pad import BoxPad, Pad, SurfacePad
from sim.scene.scene import ContactMode, Motion, Preset, Scene
from sim.scene.triangle_surface import is_mirrored
from tacauchy_rig.core.errors import ConfigError

# Of the expected depth: how much higher the far side of a tilted indenter may be. A plate's edge
# touches all around up to there. A punch's, with nodes all along, need not: preset fast errs by
# up to 3.5 %, by 4.8 % where this is 2.5 and by 8 % where it is 6.
_TILT_SHARE, _PUNCH_TILT_SHARE = 0.75, 1.5
# Of the contact's reach: so far inside the outline its edge must lie to be on the pad.
_MARGIN_SHARE = 1.02
# Of the pad's height: how deep a press to a force is taken to go.
_EXPECTED_DEPTH_SHARE = 0.2
# Of the pad's lesser half extent: no wider a contact is meshed finely.
_WIDEST_SHARE = 0.6
# Depth over the radius of a footprint's disc from which an acute corner cuts faces between their
# contact points: F_z of a 2 mm triangle, 1 mm deep, was 10 % short. From the other mu on gel sticks
# to it; with 0.2 it was cut, with 0.5 not.
_CUT_FROM, _STICKS_FROM = 0.25, 0.5
# Beyond this tilt [rad] the tangent tells nothing more.
_TILT_MAX_RAD = 1.5


class MeshKind(StrEnum):
    """How a mesh is made."""

    PAPER = "paper"
    REVOLVED = "revolved"
    FOOTPRINT = "footprint"


def mesh_choice(scene: Scene) -> tuple[MeshKind, str]:
    """Return the kind of mesh that a scene gets, and why it is that one."""
    if scene.preset is Preset.PAPER:
        return MeshKind.PAPER, "preset paper has the paper's mesh"
    if isinstance(scene.pad, SurfacePad):
        return MeshKind.FOOTPRINT, "the pad's surface comes from a file"
    if isinstance(scene.indenter, MeshIndenter):
        return MeshKind.FOOTPRINT, "the indenter is a mesh"
    tilt = math.hypot(*scene.motion.tilt_rad)
    if tilt != 0.0 and not isinstance(scene.indenter, Sphere):
        rise = 2.0 * contact_reach(scene) * math.tan(min(tilt, _TILT_MAX_RAD))
        share = _PUNCH_TILT_SHARE if isinstance(scene.indenter, Cylinder) else _TILT_SHARE
        if rise > share * mesh_depth(scene):
            why = "the indenter is tilted so far that it touches on one side"
            return MeshKind.FOOTPRINT, why
    start = np.array(contact_centre(scene))
    ways = np.stack([start, start + np.array(scene.motion.shift_m)])
    if scene.pad.distance_to_outline(ways).min() < _MARGIN_SHARE * contact_reach(scene):
        return MeshKind.FOOTPRINT, "the indenter's edge lies beside the pad"
    return MeshKind.REVOLVED, "round, upright, its edge all on the pad"


def has_brick(scene: Scene) -> bool:
    """Return whether a footprint mesh begins with a regular one, not with fTetWild's."""
    # Under layers it has a fourth to all of the tetrahedra on long edges, and more on short ones.
    is_long = scene.preset is Preset.FAST and scene.refinement <= 1.0
    return isinstance(scene.pad, BoxPad) and (is_long or not scene.layers)


@lru_cache(maxsize=8)
def mirrors(scene: Scene) -> MirrorSymmetry:
    """Return which middle planes of the pad mirror pad, indenter and motion."""
    (kind, _), motion, indenter = mesh_choice(scene), scene.motion, scene.indenter
    is_wild = kind is MeshKind.FOOTPRINT and not has_brick(scene)
    if kind is MeshKind.PAPER or is_wild or motion.twist_rad:
        return MirrorSymmetry()
    about_x, about_y = motion.tilt_rad
    x, y = (
        not any(along)
        and (not isinstance(indenter, MeshIndenter) or is_mirrored(indenter.surface, axis))
        for axis, along in enumerate(
            zip(scene.centre_m, motion.shift_m, (about_y, about_x), strict=True)
        )
    )
    return MirrorSymmetry(mirror_x=x, mirror_y=y)


def contact_reach(scene: Scene) -> float:
    """Return about how far from its axis a round or flat, unbounded indenter will touch [m]."""
    if isinstance(scene.indenter, Cylinder):
        return scene.indenter.radius_m
    widest = _WIDEST_SHARE * min(scene.pad.half_extents())
    if not isinstance(scene.indenter, Sphere):
        return widest
    return min(contact_radius(scene, mesh_depth(scene)), widest)


def contact_centre(scene: Scene) -> tuple[float, float]:
    """Return where a contact is centred [m]: a ball that tilts rolls, and touches a dome aside."""
    pad, (x, y) = scene.pad, scene.centre_m
    if not isinstance(scene.indenter, Sphere):
        return x, y
    radius = scene.indenter.radius_m
    x, y = np.array((x, y)) + radius * tilted(*scene.motion.tilt_rad)[:2, 2]
    if not isinstance(pad, BoxPad):
        return x, y
    return x / (1.0 + radius / pad.dome_radius_x_m), y / (1.0 + radius / pad.dome_radius_y_m)


def mesh_depth(scene: Scene) -> float:
    """Return the depth that a mesh is made for [m]."""
    share = _EXPECTED_DEPTH_SHARE * scene.pad.height_m
    if scene.target.depth_m is None and isinstance(scene.indenter, MeshIndenter):
        return share
    return expected_depth(scene) or share


_DIHEDRAL_MIN_RAD = math.radians(2.0)
_RIM_REACH_SHARE = 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Resolution:
    """A mesh's numbers."""

    # Edge length at a sharp rim over the punch's radius, or over that of the disc of a footprint's
    # area
    edge_share: float
    # Edge length under a rounded indenter over the expected contact radius; under a footprint the
    # largest, over that of the disc
    smooth_share: float
    growth: float  # ratio of neighbouring edge lengths away from there
    sector_count: int = 0  # sectors of a full turn of a revolved mesh
    fillet_share: float = 0.5  # largest edge length at a rounded rim over its fillet
    rounded_share: float = 0.04  # largest edge length at a rounded rim over the punch's radius
    size_max_m: float = 2.5e-3  # largest edge length [m]
    # Largest edge length under the indenter and near it, over the pad's height
    under_share: float = math.inf


_FOOTPRINTS = {
    Preset.FAST: Resolution(
        edge_share=0.06, smooth_share=0.40, growth=3.0, fillet_share=1.5, size_max_m=5e-3
    ),
    Preset.BALANCED: Resolution(edge_share=0.06, smooth_share=0.30, growth=2.2, fillet_share=1.0),
    Preset.ACCURATE: Resolution(edge_share=0.03, smooth_share=0.20, growth=1.9),
    Preset.REFERENCE: Resolution(edge_share=0.02, smooth_share=0.14, growth=1.7),
}
# Preset fast of a light scene.
_LIGHT_FOOTPRINT = Resolution(
    edge_share=0.20, smooth_share=0.40, growth=2.5, fillet_share=1.5, size_max_m=5e-3
)
# What fTetWild fills a pad with, to be refined.
_BASE = WildSizing(coarse_m=_FOOTPRINTS[Preset.BALANCED].size_max_m)


def wild_sizing(scene: Scene, usual: WildSizing) -> WildSizing:
    """Return fTetWild's settings: the usual ones where a scene asks for no other."""
    asked = scene.tetwild
    return replace(
        usual,
        coarse_m=usual.coarse_m if asked.l_r is None else asked.l_r * diagonal(scene.pad),
        envelope_share=asked.epsilon_r or usual.envelope_share,
        stop_energy=asked.stop_energy or usual.stop_energy,
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
    pad, sizing, largest = scene.pad, wild_sizing(scene, _BASE), scene.tetwild.l_r
    resolution = _LIGHT_FOOTPRINT if scene.is_light else _FOOTPRINTS[scene.preset]
    coarse_m = resolution.size_max_m if largest is None else sizing.coarse_m
    # Before fTetWild is asked: an indenter beside the pad needs no mesh.
    touched, shares = _scene_footprint(scene), interface_shares(scene.layers)
    if isinstance(pad, BoxPad) and has_brick(scene):
        symmetry = symmetry or MirrorSymmetry()
        base = brick_mesh(pad, spacing_m=coarse_m, symmetry=symmetry, interface_shares=shares)
    else:
        key = mesh_key(pad, sizing, shares)
        wild = partial(wild_mesh, pad, sizing, name=f"fTetWild, {key}", interface_shares=shares)
        base = stored_mesh("base", key, partial(wild, graded=False))
    edge_m = resolution.edge_share * touched.radius_m
    if isinstance(scene.indenter, Cylinder) and scene.indenter.fillet_m > 0.0:
        edge_m = min(edge_m, resolution.fillet_share * scene.indenter.fillet_m)
    size_at = sizing_field(
        touched,
        edge_m=edge_m / refinement,
        inside_m=resolution.smooth_share * touched.radius_m / refinement,
        slope=(1.0 - 1.0 / resolution.growth) / refinement,
        coarse_m=coarse_m / refinement,
    )
    reach_m = 2.0 * sizing.envelope_share * diagonal(pad)
    fitted = with_top_fitted(bisected_level(base, pad, size_at), pad, reach_m=reach_m)
    reach_m = _RIM_REACH_SHARE * edge_m / refinement
    fitted = with_rim_fitted(fitted, pad, touched.rim, reach_m=reach_m)
    mesh = replace(fitted, name=f"footprint, {scene.preset.value}, on {base.name}")
    refuse_flat(mesh, scene.tetwild.dihedral_min_rad or _DIHEDRAL_MIN_RAD)
    return mesh


def sharp_edge_m(scene: Scene) -> float:
    """Return how long a scene's edges are at an indenter's sharp edges [m]; zero without those."""
    touched = _scene_footprint(scene)
    edge_m = _FOOTPRINTS[scene.preset].edge_share * touched.radius_m / scene.refinement
    return edge_m if len(touched.edge) else 0.0


def is_cut(scene: Scene, *, slides: bool = True) -> bool:
    """Return whether an acute corner is deep in gel that ``slides`` past it, or else sticks."""
    body, sticks = scene.indenter, scene.contact is not ContactMode.FRICTIONLESS
    sticks = sticks and (scene.contact is ContactMode.BONDED or scene.friction >= _STICKS_FROM)
    if not isinstance(body, MeshIndenter) or sticks is slides:
        return False
    deep = mesh_depth(scene) > _CUT_FROM * _scene_footprint(scene).radius_m
    return scene.preset is not Preset.PAPER and body.has_acute_corner and deep


def _scene_footprint(scene: Scene) -> Footprint:
    """Return where a scene's indenter touches the pad, before it is carried along and after."""
    return _footprint(scene.pad, scene.indenter, scene.motion, scene.centre_m, mesh_depth(scene))


@lru_cache(maxsize=8)
def _footprint(
    pad: Pad, indenter: Indenter, motion: Motion, centre_m: tuple[float, float], depth_m: float
) -> Footprint:
    turned = TurnedIndenter(indenter=indenter, rotation=tilted(*motion.tilt_rad))
    start = footprint(pad, turned, centre_m=centre_m, depth_m=depth_m)
    if not any(motion.shift_m):
        return start
    x, y = np.array(centre_m) + np.array(motion.shift_m)
    try:
        return start.joined(footprint(pad, turned, centre_m=(x, y), depth_m=depth_m))
    except ConfigError:
        # It is carried off the pad, where it touches nothing.
        return start


def diagonal(pad: Pad) -> float:
    """Return the diagonal of a pad's bounding box [m]."""
    half_x, half_y = pad.half_extents()
    return math.hypot(2.0 * half_x, 2.0 * half_y, pad.height_m)
