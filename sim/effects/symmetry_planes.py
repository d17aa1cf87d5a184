"""Planes of symmetry of a scene: a half or a quarter of the pad is solved for the whole."""

from functools import lru_cache

from sim.effects.mesh_choice import MeshKind, has_brick, mesh_choice
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import Scene
from sim.scene.triangle_surface import is_mirrored


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
