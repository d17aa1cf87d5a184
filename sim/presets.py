"""Presets: which element and mesh a scene gets, and what force error that is believed to have."""

from __future__ import annotations

from sim.elements import ElementOrder
from sim.indenter import Cylinder, Sphere
from sim.laws.catalogue import law
from sim.mesh import TetMesh
from sim.model import ContactOptions, Model
from sim.scene import ContactMode, Preset, Scene
from sim.swept_mesh import SweptSizing, swept_mesh

_SIZES = {Preset.FAST: 0.4e-3, Preset.BALANCED: 0.2e-3, Preset.ACCURATE: 0.1e-3}


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
    radius = 1.5e-3
    if isinstance(scene.indenter, Cylinder):
        radius = scene.indenter.radius_m
    elif isinstance(scene.indenter, Sphere):
        radius = 0.5 * scene.indenter.radius_m
    sizing = SweptSizing(
        rim_radius_m=radius, centre_m=scene.centre_m, rim_size_m=_SIZES.get(scene.preset, 0.4e-3)
    )
    return swept_mesh(scene.pad, sizing, name=f"swept {scene.preset.value}")


def force_error_estimate(scene: Scene, depth_m: float) -> tuple[float | None, str]:
    """Return the believed relative error of F_z, and how it is known."""
    return None, f"not known for this scene at {depth_m * 1e3:.3g} mm"
