"""Presets: which element and mesh a scene gets."""

from __future__ import annotations

from dataclasses import dataclass

from sim.elements import ElementOrder
from sim.graded_plane import Grading
from sim.indenter import Cylinder, Sphere
from sim.laws.catalogue import law
from sim.layers import element_constants, interface_shares, law_name
from sim.mesh import TetMesh
from sim.mesh_store import mesh_key, stored_mesh
from sim.model import Model
from sim.pad import Pad
from sim.revolved_mesh import revolved_mesh
from sim.scene import ContactMode, Preset, Scene
from sim.state import ContactOptions
from sim.wild_mesh import WildSizing, wild_mesh

PAPER_SIZING = WildSizing()
_FILLET_SHARE = 0.5
_EXPECTED_DEPTH_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Resolution:
    """A revolved mesh's numbers.

    Attributes:
        edge_share: Edge length at a punch's rim over its radius.
        smooth_share: Edge length under a rounded indenter over the expected contact radius.
        growth: Ratio of neighbouring edge lengths away from there.
        sector_count: Sectors of a full turn.
    """

    edge_share: float
    smooth_share: float
    growth: float
    sector_count: int


RESOLUTIONS = {
    Preset.FAST: Resolution(edge_share=0.04, smooth_share=0.25, growth=2.0, sector_count=16),
    Preset.BALANCED: Resolution(edge_share=0.02, smooth_share=0.17, growth=1.8, sector_count=16),
    Preset.ACCURATE: Resolution(edge_share=0.01, smooth_share=0.10, growth=1.6, sector_count=24),
    Preset.REFERENCE: Resolution(edge_share=0.01, smooth_share=0.07, growth=1.4, sector_count=32),
}


def build_model(scene: Scene, *, device: str = "cpu") -> Model:
    """Mesh a scene's pad and set up its model.

    Raises:
        ConfigError: The pad cannot be meshed for this indenter, or the layers do not fit together.
    """
    name = law_name(scene.material, scene.layers)
    mesh = mesh_for(scene)
    young, poisson = element_constants(mesh, scene.material, scene.layers)
    options = ContactOptions(
        distance_m=scene.barrier_m,
        bonded=scene.contact is ContactMode.BONDED,
        friction=scene.friction if scene.contact is ContactMode.FRICTION else 0.0,
    )
    return Model(
        mesh,
        order=ElementOrder.P1 if scene.preset is Preset.PAPER else ElementOrder.P2,
        law=law(name),
        young_pa=young,
        poisson=poisson,
        contact_options=options,
        device=device,
    )


def mesh_for(scene: Scene) -> TetMesh:
    """Return the mesh of a scene's preset."""
    shares = interface_shares(scene.layers)
    if scene.preset is Preset.PAPER:
        return _paper_mesh(scene.pad, shares)
    resolution = RESOLUTIONS[scene.preset]
    return revolved_mesh(
        scene.pad,
        _grading(scene, resolution),
        centre_m=scene.centre_m,
        sector_count=resolution.sector_count,
        name=f"revolved, {scene.preset.value}",
        interface_shares=shares,
    )


def _paper_mesh(pad: Pad, shares: tuple[float, ...]) -> TetMesh:
    key = mesh_key(pad, PAPER_SIZING, *([shares] if shares else []))
    return stored_mesh(
        "paper",
        key,
        lambda: wild_mesh(
            pad, PAPER_SIZING, name=f"fTetWild, paper, {key}", interface_shares=shares
        ),
    )


def _grading(scene: Scene, resolution: Resolution) -> Grading:
    indenter = scene.indenter
    if isinstance(indenter, Cylinder):
        size = resolution.edge_share * indenter.radius_m
        if indenter.fillet_m > 0.0:
            size = min(size, _FILLET_SHARE * indenter.fillet_m)
        start, end = indenter.radius_m - indenter.fillet_m, indenter.radius_m
    else:
        start, end = 0.0, _contact_radius(scene)
        size = resolution.smooth_share * end
    return Grading(start_m=start, end_m=end, size_m=size, growth=resolution.growth)


def _contact_radius(scene: Scene) -> float:
    """Return about how wide a rounded or flat, unbounded indenter will touch [m]."""
    if not isinstance(scene.indenter, Sphere):
        return 0.6 * min(scene.pad.half_extents())
    radius = scene.indenter.radius_m
    depth = scene.target.depth_m or _EXPECTED_DEPTH_SHARE * scene.pad.height_m
    widest = min(radius, 0.6 * min(scene.pad.half_extents()))
    return float(min((1.5 * radius * depth) ** 0.5, widest))
