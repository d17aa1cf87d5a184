"""Presets: which element and mesh a scene gets; with ``refinement`` edges so many times shorter."""

from dataclasses import fields, replace
from functools import partial

from sim.contact.surface_and_grip import ContactOptions
from sim.effects import mesh_choice as meshes
from sim.effects.depth_and_inertia_scales import expected_depth
from sim.effects.planned_effects import EffectPlan, full_plan
from sim.material.elastic_body import element_constants
from sim.material.laws.law_and_lame import law
from sim.material.relaxation import prony_series
from sim.mesh.cached_tet_mesh import TetMesh, mesh_key, refuse_flat, stored_mesh
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.material import LawName, interface_shares, law_name, sector_factor
from sim.scene.pad import SurfacePad
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from sim.solve.model import Model

PAPER_SIZING = WildSizing()
_SLOPE_MAX = 0.75
# Away from a fillet, growth and edges decide F_z, sectors and the rim's edges do not. Under a ball
# the pressure is round to 3 % of its maximum and 2 % off Hertz (docs/explanation/meshes.md).
RESOLUTIONS = {
    Preset.FAST: meshes.Resolution(edge_share=0.04, smooth_share=0.25, growth=2.0, sector_count=16),
    Preset.BALANCED: meshes.Resolution(
        edge_share=0.02, smooth_share=0.09, growth=1.5, sector_count=24, size_max_m=1.5e-3
    ),
    Preset.ACCURATE: meshes.Resolution(
        edge_share=0.01, smooth_share=0.08, growth=1.4, sector_count=28, size_max_m=1.25e-3
    ),
    Preset.REFERENCE: meshes.Resolution(
        edge_share=0.01,
        smooth_share=0.07,
        growth=1.3,
        sector_count=36,
        fillet_share=0.25,
        size_max_m=1e-3,
    ),
}

# Preset fast of a light scene: at a rim an edge as long as the fillet. A 5 mm cylinder 1 mm deep,
# against preset accurate: fillet 0.3 mm +2.0 %, fillet 0.1 mm +5.9 %.
LIGHT = replace(RESOLUTIONS[Preset.FAST], fillet_share=1.0, rounded_share=0.12)
# A light scene's edges under the indenter, over the pad's height, where nu is above this: at 0.499
# a punch is 5.6 % too stiff without, 4.3 % with.
_KEEPS_VOLUME_ABOVE, _UNDER_SHARE = 0.49, 0.25
# Where shear is asked for and points may slide, edges are so many times shorter there: the shear
# has a kink where sliding begins, which edges smear (docs/results/verification.md).
_SHEAR_REFINEMENT = {Preset.BALANCED: 1.25, Preset.ACCURATE: 1.9, Preset.REFERENCE: 1.9}
# There a point that sticks gives by a tenth of the usual slip length, which would take 3 to 5 % off
# the shear under a turned ball.
_SHEAR_SLIP_M = 0.1e-6
# Of the pad's height beyond an indenter's end: so far the gel flows.
_NEAR_SHARE = 0.7
# A light scene's F_z is decided in the section through its axis: a punch of 4 mm is 2.4 % off with
# 16 sectors, 2.2 % with 24, for 1.5 to 2 times the time, and 3.3 % with 12.
_SECTOR_GROWTH, _SECTOR_BASE = 0.5, 1.6
# Of a light scene whose indenter is carried, turned or tilted, where half or all of the pad is
# meshed: F_z of nine such presses is 0 to 0.9 % larger than with edges of at most 2.5 mm.
_MOVED_SIZE_MAX_M = 4e-3
# Of edges under a ball where a way of its own ends on preset fast's. With 2.0, a ring of elements
# more or less above the base changes F_z by 0.5 %: 0.9 % of F_z remained under 45 balls, now 0.3.
_END_GROWTH = 1.7
# Of an edge at a sharp rim, and of the depth: radius that the rim is given. A mesh follows no
# corner, and what it catches of one hangs on chance: F_z of a 5 mm punch, 0.5 mm deep, on three
# edges a tenth apart is 3.11, 3.08 and 3.12 N without, 2.99, 3.01 and 2.98 N with a quarter of an
# edge, and tends to 2.986 N. Half an edge is 1 to 2 % too soft where the depth is less.
# Twice as much past an acute corner, where faces would stretch without end, takes 0.8 % off F_z.
_RIM_SHARE = 0.25
# Of an edge where gel slips: with less it slips half an edge at a time, at another depth on the way
# down than up, by 0.8 % of F_z. Where a press ends it slips past a rim so many times rounder first.
_SLIPPED_RIM_SHARE, ROUNDER = 0.5, 6.0
# Of the depth: as much of a pointed tip may be cut off by that.
_BLUNTED_SHARE = 0.05


def light_resolution(refinement: float) -> meshes.Resolution:
    """Return a light scene's resolution with every edge of its section so many times shorter."""
    found = refined(LIGHT, refinement)
    count = LIGHT.sector_count * (refinement / _SECTOR_BASE) ** _SECTOR_GROWTH
    least = LIGHT.sector_count if refinement >= 1.0 else 8
    return replace(found, sector_count=max(least, 4 * round(0.25 * count)))


def refined(resolution: meshes.Resolution, factor: float) -> meshes.Resolution:
    """Return a resolution with every edge ``factor`` times shorter, near the indenter and away."""
    if factor == 1.0:
        return resolution
    slope = min((resolution.growth - 1.0) / resolution.growth / factor, _SLOPE_MAX)
    lengths = {each.name: getattr(resolution, each.name) / factor for each in fields(resolution)}
    sectors = max(8, 4 * round(0.25 * resolution.sector_count * factor))
    return meshes.Resolution(**{**lengths, "growth": 1.0 / (1.0 - slope), "sector_count": sectors})


def build_model(
    scene: Scene,
    *,
    plan: EffectPlan | None = None,
    refinement: float = 1.0,
    mesh: TetMesh | None = None,
    device: str = "cpu",
) -> Model:
    """Mesh a scene's pad and set up its model.

    Args:
        plan: Effects to include; None includes all that the scene has.

    Raises:
        ConfigError: The pad cannot be meshed for this indenter, or the layers do not fit together.
    """
    plan = plan or full_plan(scene)
    name = law_name(scene.material, scene.layers)
    if not plan.is_on(Effect.FINITE_STRAIN):
        name = LawName.LINEAR
    if mesh is None:
        mesh = mesh_for(scene, symmetric=plan.is_on(Effect.SYMMETRY), refinement=refinement)
    young, poisson = element_constants(mesh, scene.materials)
    relaxation = [material.relaxation for material in scene.materials]
    relaxes = plan.is_on(Effect.VISCOELASTICITY)
    options = ContactOptions(
        distance_m=scene.contact_distance_m,
        bonded=scene.contact is ContactMode.BONDED,
        friction=scene.friction if plan.is_on(Effect.FRICTION) else 0.0,
        slip_m=_SHEAR_SLIP_M if Output.SHEAR in scene.outputs else ContactOptions().slip_m,
        many_points=meshes.is_cut(scene) or slips(scene),
        extension=1.0 if scene.has_wide_barrier else ContactOptions().extension,
    )
    return Model(
        mesh,
        order=ElementOrder.P2 if plan.is_on(Effect.LOCKING_FREE_ELEMENT) else ElementOrder.P1,
        law=law(name),
        young_pa=young,
        poisson=poisson,
        contact_options=options,
        prony=prony_series(relaxation, mesh.labels) if relaxes else None,
        device=device,
    )


def mesh_for(
    scene: Scene,
    *,
    symmetric: bool = True,
    refinement: float = 1.0,
    resolution: meshes.Resolution | None = None,
) -> TetMesh:
    """Return the mesh of a scene's preset, of the kind that ``mesh_choice`` says.

    Preset paper has but one mesh. A revolved mesh takes a given resolution instead of the preset's.
    """
    shares = interface_shares(scene.layers)
    symmetry = meshes.mirrors(scene) if symmetric else MirrorSymmetry()
    if scene.preset is Preset.PAPER:
        return _paper_mesh(scene, shares)
    kind, _ = meshes.mesh_choice(scene)
    if isinstance(scene.pad, SurfacePad) or kind is meshes.MeshKind.FOOTPRINT:
        finer = refinement * scene.refinement
        return meshes.footprint_mesh(scene, symmetry=symmetry, refinement=finer)
    resolution = refined(_scene_resolution(scene, resolution), refinement)
    return revolved_mesh(
        scene.pad,
        _grading(scene, resolution),
        centre_m=meshes.contact_centre(scene),
        sector_count=round(resolution.sector_count * sector_factor(scene.layers)),
        name=f"revolved, {scene.preset.value}",
        interface_shares=shares,
        symmetry=symmetry,
    )


def finest_edge_m(scene: Scene) -> float:
    """Return the edge length that a scene's preset gives to the indenter's rim or contact [m]."""
    return _grading(scene, _resolution(scene)).size_m


def regularised_indenter(scene: Scene, *, refinement: float = 1.0, wider: float = 1.0) -> Indenter:
    """Return the mesh-regularised indenter: sharp edges are rounded by a share of an edge."""
    indenter = scene.indenter
    if scene.preset is Preset.PAPER:
        return indenter
    if isinstance(indenter, MeshIndenter):
        depth_m = meshes.mesh_depth(scene)
        share = (1 + meshes.is_cut(scene)) * _RIM_SHARE
        radius_m = share * min(meshes.sharp_edge_m(scene) / refinement, depth_m)
        rounded = indenter.with_edges(radius_m)
        blunt = rounded.blunted_m / (_BLUNTED_SHARE * depth_m)
        return rounded if blunt <= 1.0 else indenter.with_edges(radius_m / blunt)
    if not isinstance(indenter, Cylinder) or indenter.fillet_m > 0.0:
        return indenter
    edge_m = finest_edge_m(scene) / (scene.refinement * refinement)
    share = _SLIPPED_RIM_SHARE if slips(scene) else _RIM_SHARE
    fillet_m = wider * min(share * edge_m, _RIM_SHARE * expected_depth(scene))
    return replace(indenter, fillet_m=min(fillet_m, indenter.radius_m))


def slips(scene: Scene) -> bool:
    """Return whether gel slips past a sharp rim of a press that is no rough one."""
    is_rough = scene.preset in (Preset.FAST, Preset.PAPER)
    return scene.has_sharp_rim and scene.contact is not ContactMode.BONDED and not is_rough


def _scene_resolution(scene: Scene, given: meshes.Resolution | None) -> meshes.Resolution:
    """Return a preset's resolution or the one that is given, refined as the scene has it."""
    if given is None and scene.is_light:
        found = light_resolution(scene.refinement)
        if max(material.poisson for material in scene.materials) > _KEEPS_VOLUME_ABOVE:
            found = replace(found, under_share=_UNDER_SHARE / scene.refinement)
        if isinstance(scene.indenter, Sphere) and scene.path_refinement and scene.refinement == 1.0:
            found = replace(found, growth=_END_GROWTH)
        if scene.motion.is_straight:
            return found
        return replace(found, size_max_m=_MOVED_SIZE_MAX_M / scene.refinement)
    return refined(given or _resolution(scene), scene.refinement)


def _resolution(scene: Scene) -> meshes.Resolution:
    """Return a scene's resolution, finer where shear is asked for and points may slide."""
    if scene.is_light:
        return LIGHT
    resolution = RESOLUTIONS[scene.preset]
    if Output.SHEAR in scene.outputs and scene.contact is ContactMode.FRICTION:
        shorter = _SHEAR_REFINEMENT.get(scene.preset, 1.0)
        resolution = replace(
            resolution,
            smooth_share=resolution.smooth_share / shorter,
            sector_count=4 * round(0.25 * shorter * resolution.sector_count),
        )
    return resolution


def _paper_mesh(scene: Scene, shares: tuple[float, ...]) -> TetMesh:
    pad, sizing = scene.pad, meshes.wild_sizing(scene, PAPER_SIZING)
    key = mesh_key(pad, sizing, *([shares] if shares else []))
    name = f"fTetWild, paper, {key}"
    wild = partial(wild_mesh, pad, sizing, name=name, interface_shares=shares)
    mesh = stored_mesh("paper", key, wild)
    refuse_flat(mesh, scene.tetwild.dihedral_min_rad or 0.0)
    return mesh


def _grading(scene: Scene, resolution: meshes.Resolution) -> Grading:
    indenter = scene.indenter
    if isinstance(indenter, Cylinder):
        size = resolution.edge_share * indenter.radius_m
        if indenter.fillet_m > 0.0:
            coarsest = resolution.rounded_share * indenter.radius_m
            size = min(coarsest, resolution.fillet_share * indenter.fillet_m)
        start, end = indenter.radius_m - indenter.fillet_m, indenter.radius_m
    else:
        start, end = 0.0, meshes.contact_reach(scene)
        size = resolution.smooth_share * end
    return Grading(
        start_m=start,
        end_m=end,
        size_m=size,
        growth=resolution.growth,
        size_max_m=resolution.size_max_m,
        near_max_m=resolution.under_share * scene.pad.height_m,
        near_m=end + _NEAR_SHARE * scene.pad.height_m,
    )
