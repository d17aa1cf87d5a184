"""Presets: which element and mesh a scene gets, and what force error that is believed to have."""

from __future__ import annotations

from dataclasses import dataclass

from sim.elements import ElementOrder
from sim.graded_plane import Grading
from sim.indenter import Cylinder, Sphere
from sim.laws.catalogue import law
from sim.mesh import TetMesh
from sim.model import ContactOptions, Model
from sim.revolved_mesh import revolved_mesh
from sim.scene import ContactMode, Preset, Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class _Resolution:
    """Edge length at a punch's rim as a share of its radius, and sectors of a turn."""

    size_share: float
    growth: float
    sector_count: int


_FILLET_SHARE = 0.5
_RESOLUTIONS = {
    Preset.FAST: _Resolution(size_share=0.08, growth=2.0, sector_count=16),
    Preset.BALANCED: _Resolution(size_share=0.04, growth=1.8, sector_count=16),
    Preset.ACCURATE: _Resolution(size_share=0.02, growth=1.6, sector_count=24),
}


def build_model(scene: Scene, *, device: str = "cpu") -> Model:
    """Mesh a scene's pad and set up its model."""
    options = ContactOptions(distance_m=scene.barrier_m, bonded=scene.contact is ContactMode.BONDED)
    return Model(
        mesh_for(scene),
        order=ElementOrder.P1 if scene.preset is Preset.PAPER else ElementOrder.P2,
        law=law(scene.material.law),
        young_pa=scene.material.young_pa,
        poisson=scene.material.poisson,
        contact_options=options,
        device=device,
    )


def mesh_for(scene: Scene) -> TetMesh:
    """Return the mesh of a scene's preset."""
    resolution = _RESOLUTIONS[scene.preset]
    start, end = _fine_stretch(scene)
    size = resolution.size_share * end
    if end > start > 0.0:
        size = min(size, _FILLET_SHARE * (end - start))
    grading = Grading(
        start_m=start,
        end_m=end,
        size_m=size,
        growth=resolution.growth,
    )
    return revolved_mesh(
        scene.pad,
        grading,
        centre_m=scene.centre_m,
        sector_count=resolution.sector_count,
        name=f"revolved, {scene.preset.value}",
    )


def _fine_stretch(scene: Scene) -> tuple[float, float]:
    """Return the radii between which the contact's edge is expected [m]."""
    if isinstance(scene.indenter, Cylinder):
        return scene.indenter.radius_m - scene.indenter.fillet_m, scene.indenter.radius_m
    if isinstance(scene.indenter, Sphere):
        return 0.0, 0.5 * scene.indenter.radius_m
    return 0.0, 0.25 * scene.pad.height_m


def force_error_estimate(scene: Scene, depth_m: float) -> tuple[float | None, str]:
    """Return the believed relative error of F_z, and how it is known."""
    return None, f"not known for this scene at {depth_m * 1e3:.3g} mm"
