"""Which kind of mesh a scene gets.

Revolved meshes are better where they serve: the same on every machine, nodes on the rim, few
tetrahedra. They need an indenter that is round seen from above and stands upright, its edge on the
pad all around, and a pad with a known outline. Everything else gets a mesh of its own by fTetWild,
fine where the indenter's footprint has its edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim.effects.estimates import contact_radius, expected_depth
from sim.mesh.symmetry import MirrorSymmetry
from sim.scene.indenter import Cylinder, MeshIndenter, Sphere
from sim.scene.pad import BoxPad, SurfacePad
from sim.scene.scene import Preset, Scene
from sim.scene.triangle_surface import is_mirrored

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
# Beyond this tilt [rad] the tangent tells nothing more.
_TILT_MAX_RAD = 1.5


class MeshKind(StrEnum):
    """How a mesh is made."""

    PAPER = "paper"
    REVOLVED = "revolved"
    FOOTPRINT = "footprint"


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshChoice:
    """A kind of mesh, and why it is that one."""

    kind: MeshKind
    reason: str


def mesh_choice(scene: Scene) -> MeshChoice:
    """Return the kind of mesh that a scene gets."""
    if scene.preset is Preset.PAPER:
        return MeshChoice(kind=MeshKind.PAPER, reason="preset paper has the paper's mesh")
    against = _not_revolved(scene)
    if against:
        return MeshChoice(kind=MeshKind.FOOTPRINT, reason=against)
    return MeshChoice(kind=MeshKind.REVOLVED, reason="round, upright, its edge all on the pad")


def has_brick(scene: Scene) -> bool:
    """Return whether a footprint mesh begins with a regular one, not with fTetWild's."""
    return isinstance(scene.pad, BoxPad) and not scene.layers


def mirrors(scene: Scene) -> MirrorSymmetry:
    """Return which middle planes of the pad mirror pad, indenter and motion."""
    motion, indenter, kind = scene.motion, scene.indenter, mesh_choice(scene).kind
    is_wild = kind is MeshKind.FOOTPRINT and not has_brick(scene)
    if kind is MeshKind.PAPER or is_wild or motion.twist_rad:
        return MirrorSymmetry()
    about_x, about_y = (0.0, 0.0) if isinstance(indenter, Sphere) else motion.tilt_rad
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


def mesh_depth(scene: Scene) -> float:
    """Return the depth that a mesh is made for [m]."""
    share = _EXPECTED_DEPTH_SHARE * scene.pad.height_m
    if scene.target.depth_m is None and isinstance(scene.indenter, MeshIndenter):
        return share
    return expected_depth(scene) or share


def _not_revolved(scene: Scene) -> str:
    """Say why no revolved mesh serves a scene, or nothing."""
    if isinstance(scene.pad, SurfacePad):
        return "the pad's surface comes from a file"
    if isinstance(scene.indenter, MeshIndenter):
        return "the indenter is a mesh"
    if _lifts_its_rim(scene):
        return "the indenter is tilted so far that it touches on one side"
    reach = _MARGIN_SHARE * contact_reach(scene)
    start = np.array(scene.centre_m)
    ways = np.stack([start, start + np.array(scene.motion.shift_m)])
    if scene.pad.distance_to_outline(ways).min() < reach:
        return "the indenter's edge lies beside the pad"
    return ""


def _lifts_its_rim(scene: Scene) -> bool:
    tilt = math.hypot(*scene.motion.tilt_rad)
    if tilt == 0.0 or isinstance(scene.indenter, Sphere):
        return False
    rise = 2.0 * contact_reach(scene) * math.tan(min(tilt, _TILT_MAX_RAD))
    share = _PUNCH_TILT_SHARE if isinstance(scene.indenter, Cylinder) else _TILT_SHARE
    return rise > share * mesh_depth(scene)
