"""How fine each preset is around a footprint, and the mesh that a scene gets by that."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.filling import Filling
from sim.footprint import Footprint, footprint
from sim.footprint_sizing import FootprintSizing
from sim.indenter import Cylinder, Indenter
from sim.mesh import TetMesh, mesh_statistics
from sim.mesh_choice import footprint_depth
from sim.mesh_indenter import MeshIndenter
from sim.mesh_store import mesh_key, stored_mesh
from sim.pad import Pad
from sim.scene import Preset, Scene
from sim.turned_indenter import TurnedIndenter, tilted
from sim.wild_mesh import WildSettings, filled_pad
from tacauchy_rig.errors import ConfigError

_SPACING_M = 0.8e-3
_COARSE_M = 2.5e-3
_FILLING = Filling(epsilon_r=1e-3, stop_energy=10.0, dihedral_min_rad=math.radians(2.0))
# Raised when the same settings come to give another mesh.
_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class FootprintResolution:
    """A footprint mesh's numbers.

    Attributes:
        edge_share: Edge length at a sharp edge of the contact over the radius of the disc of the
            same area.
        inside_share: Largest edge length under the contact over that radius.
        fillet_share: Largest edge length at a rounded rim over its fillet.
        growth: Ratio of neighbouring edge lengths away from there.
    """

    edge_share: float
    inside_share: float
    fillet_share: float
    growth: float


FOOTPRINT_RESOLUTIONS = {
    Preset.FAST: FootprintResolution(
        edge_share=0.08, inside_share=0.30, fillet_share=1.0, growth=2.2
    ),
    Preset.BALANCED: FootprintResolution(
        edge_share=0.04, inside_share=0.20, fillet_share=0.5, growth=2.0
    ),
    Preset.ACCURATE: FootprintResolution(
        edge_share=0.02, inside_share=0.14, fillet_share=0.5, growth=1.8
    ),
    Preset.REFERENCE: FootprintResolution(
        edge_share=0.015, inside_share=0.10, fillet_share=0.5, growth=1.6
    ),
}


def footprint_mesh(
    scene: Scene, *, shares: tuple[float, ...] = (), refinement: float = 1.0
) -> TetMesh:
    """Return a mesh of the whole pad, fine where a scene's indenter touches; made once and kept.

    Args:
        shares: Rising shares of the local height at which layers meet.
        refinement: Make every edge this many times shorter.

    Raises:
        ConfigError: The indenter stands beside the pad, or fTetWild cannot fill it as asked.
    """
    resolution, depth = FOOTPRINT_RESOLUTIONS[scene.preset], _rounded(footprint_depth(scene))
    where = (scene.centre_m, scene.motion.shift_m, scene.motion.tilt_rad)
    numbers = (resolution, refinement, scene.filling, shares, _VERSION)
    key = mesh_key(scene.pad, _identity(scene.indenter), where, depth, *numbers)
    # Before the store is asked: an indenter beside the pad has no mesh at all.
    touched = scene_footprint(scene, depth_m=depth)
    name = f"fTetWild, footprint, {scene.preset.value}, {key}"

    def make() -> TetMesh:
        sizing = _sizing(scene, touched, resolution, refinement)
        return _checked(_filled(scene, sizing, name, shares), scene.filling)

    return stored_mesh("footprint", key, make)


def scene_footprint(scene: Scene, *, depth_m: float) -> Footprint:
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


def _sizing(
    scene: Scene, touched: Footprint, resolution: FootprintResolution, refinement: float
) -> FootprintSizing:
    edge = resolution.edge_share * touched.radius_m
    if isinstance(scene.indenter, Cylinder) and scene.indenter.fillet_m > 0.0:
        edge = min(edge, resolution.fillet_share * scene.indenter.fillet_m)
    return FootprintSizing(
        footprint=touched,
        edge_m=edge / refinement,
        inside_m=resolution.inside_share * touched.radius_m / refinement,
        growth=1.0 / (1.0 - (1.0 - 1.0 / resolution.growth) / refinement),
        coarse_m=_coarse_m(scene) / refinement,
    )


def _filled(scene: Scene, sizing: FootprintSizing, name: str, shares: tuple[float, ...]) -> TetMesh:
    filling = scene.filling
    return filled_pad(
        scene.pad,
        sizing.background(scene.pad),
        WildSettings(
            spacing_m=_SPACING_M,
            coarse_m=sizing.coarse_m,
            envelope_share=filling.epsilon_r or _FILLING.epsilon_r or 0.0,
            stop_energy=filling.stop_energy or _FILLING.stop_energy or 0.0,
            fitted=True,
        ),
        name=name,
        interface_shares=shares,
    )


def _coarse_m(scene: Scene) -> float:
    return _COARSE_M if scene.filling.l_r is None else scene.filling.l_r * diagonal(scene.pad)


def diagonal(pad: Pad) -> float:
    """Return the diagonal of a pad's bounding box [m]."""
    half_x, half_y = pad.half_extents()
    return math.hypot(2.0 * half_x, 2.0 * half_y, pad.height_m)


def _checked(mesh: TetMesh, filling: Filling) -> TetMesh:
    asked = math.degrees(filling.dihedral_min_rad or _FILLING.dihedral_min_rad or 0.0)
    found = mesh_statistics(mesh).dihedral_min_deg
    if found < asked:
        raise ConfigError(
            f"fTetWild's mesh has an angle of {found:.3g} deg between faces of a tetrahedron, "
            f"less than the {asked:.3g} deg asked for",
            remedy="run again, which gives another mesh; lower stop_energy; or ask for less",
        )
    return mesh


def _rounded(depth_m: float) -> float:
    """Return a depth rounded to half powers of two, so that like presses share a mesh."""
    return float(2.0 ** (0.5 * round(2.0 * math.log2(depth_m))))


def _identity(indenter: Indenter) -> str:
    return indenter.content_hash if isinstance(indenter, MeshIndenter) else repr(indenter)
