"""Corrected force and depth: the known bias of a mesh is subtracted.

A conforming mesh and a wide barrier make a gel too stiff, the more so the more it keeps its volume.
On a mesh whose edges follow the contact's size the bias of F_z is

    bias = share + slope u,    u = min(nu / (1 - 2 nu), 18)

under any body. A ball that sticks holds the volume under it and multiplies u; a revolved mesh is
distorted between the contact and a near side of the pad, which adds to the share. ``share`` and
``slope`` were fitted to drawn scenes, for each refinement of the end state's mesh. What may remain
is a share of the bias. Richardson extrapolation (1911) from the coarser load-step mesh did not
improve scenes left out: the meshes are not nested, and the barrier's width is bounded.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from sim.effects.depth_and_inertia_scales import contact_radius, expected_depth
from sim.effects.mesh_choice import MeshKind, contact_centre, mesh_choice
from sim.effects.planned_effects import EffectPlan
from sim.effects.press_outputs import PressOutputs
from sim.scene.indenter import Cylinder, MeshIndenter, Sphere
from sim.scene.material import LawName
from sim.scene.pad import SurfacePad
from sim.scene.scene import ContactMode, Output, Preset, Scene

WAY, WAY_WITH_FRICTION = 0.5, 0.75
"""Refinement of the load-step mesh against preset fast; below 1 is coarser. Friction depends on all
load steps, so it needs the finer of the two, except where the end state's edges are longer: 0.3 and
0.45 then differ by 0.1 and 0.3 % of F_z."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A preset, and refinements of its meshes: 2 halves every edge."""

    preset: Preset
    refinement: float = 1.0  # of the mesh of the end state
    path_refinement: float | None = None  # of the load-step mesh; None where that is the same mesh

    def __str__(self) -> str:
        text = self.preset.value
        if self.refinement != 1.0:
            text += f", edges {1.0 / self.refinement:.3g} times as long"
        if self.path_refinement is not None:
            text += f", load-step edges {1.0 / self.path_refinement:.3g} times as long"
        return text

    def applied(self, scene: Scene) -> Scene:
        """Return a scene with these settings."""
        return replace(scene, **asdict(self))


@dataclass(frozen=True, slots=True)
class RelativeCost:
    """Processor time and error of F_z of a setting."""

    time_ratio: float  # over the time of preset fast
    error_ratio: float  # over the error of preset fast; where the bias is subtracted, over F_z


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasRule:
    """The bias of F_z, relative to F_z."""

    share: float  # what every scene has
    slope: float  # for one of u
    time_ratio: float  # processor time of a press over that of preset fast's, a median
    least_rest: float  # what may remain in any scene
    beside: float = 0.0  # more for a contact centred near the pad's outline
    wide_ball: float = 1.0  # of the bias: under a ball whose contact is wide against the height
    rest_share: float = 0.6  # of the bias: what may remain

    def bias(self, scene: Scene) -> float:
        """Return the bias of a scene."""
        poisson = max(material.poisson for material in scene.materials)
        locking = self.slope * min(poisson / (1.0 - 2.0 * poisson), _MOST_INCOMPRESSIBLE)
        pad, height, depth = scene.pad, scene.pad.height_m, expected_depth(scene)
        share, factor = self.share, 1.0
        if isinstance(scene.indenter, Sphere):
            slides = any((*scene.motion.shift_m, scene.motion.twist_rad))
            if scene.contact is ContactMode.FRICTION and not slides:
                locking *= 1.0 + _STICKING * scene.friction * depth / height
            if contact_radius(scene, depth) > _WIDE_SHARE * height:
                factor = self.wide_ball
        if mesh_choice(scene)[0] is MeshKind.REVOLVED and not isinstance(pad, SurfacePad):
            to_side = pad.distance_to_outline(np.array([contact_centre(scene)]))
            share += self.beside if to_side[0] < _BESIDE_SHARE * height else 0.0
        return factor * (share + locking)

    def rest(self, scene: Scene) -> float:
        """Return what may remain of a scene's bias."""
        return max(self.rest_share * self.bias(scene), self.least_rest, _FOLDED * _is_folded(scene))


def _is_folded(scene: Scene) -> bool:
    """Return whether gel folds around a deep sharp rim: F_z then differs from mesh to mesh."""
    kind, _ = mesh_choice(scene)
    is_deep = expected_depth(scene) > _FOLD_SHARE * scene.pad.height_m
    return is_deep and scene.has_sharp_rim and kind is MeshKind.REVOLVED


# Rules by refinement of the end state's mesh against preset fast, the cheapest first, fitted to
# about 100 drawn scenes of seeds 20261501 and 20261502.
_RULES: dict[float, BiasRule] = {
    1.0: BiasRule(
        share=0.0175, slope=0.0022, least_rest=0.0175, time_ratio=0.45, beside=0.012, wide_ball=0.7
    ),
    1.4: BiasRule(share=0.006, slope=0.0007, least_rest=0.005, time_ratio=0.6, beside=0.009),
    1.6: BiasRule(share=0.0045, slope=0.0006, least_rest=0.005, time_ratio=0.8, beside=0.0025),
    2.2: BiasRule(share=0.0, slope=0.0005, least_rest=0.0095, time_ratio=3.1),
}
# A sharp rim, and meshes around a footprint, are finer still at the contact's edge; eleven scenes.
# Edges of 1/0.6: 21 bodies of triangles.
_AT_EDGES = {
    0.6: BiasRule(share=0.04, slope=0.0022, least_rest=0.044, time_ratio=0.15),
    1.0: _RULES[1.0],
    1.6: BiasRule(share=0.003, slope=0.0, least_rest=0.0095, time_ratio=1.0),
}
# Tilted sharp punches on edges of 1/0.6, nine scenes: at most 2.6 % were left.
_AT_TILTED_EDGES = _AT_EDGES | {
    0.6: replace(_AT_EDGES[0.6], share=0.038, slope=0.0055, rest_share=0.4)
}
# Layered gels, eight scenes.
_AT_EDGES_LAYERED = _AT_EDGES | {1.6: replace(_AT_EDGES[1.6], share=0.01)}
# Of F_z, and from which share of the height on: five of seven such presses were 1.1 to 3.4 % off.
_FOLDED, _FOLD_SHARE = 0.025, 0.25
_MOST_INCOMPRESSIBLE = 18.0
# For one of the friction coefficient times depth over height.
_STICKING = 4.0
# Of the pad's height: a ball's contact radius from which it is wide, and how near the outline is.
_WIDE_SHARE, _BESIDE_SHARE = 0.45, 1.25
# Of the pad's height: deeper presses were not among those that were drawn.
_DEEPEST_SHARE = 0.45
# E of the stiffest layer over that of the softest.
_LAYERS_APART = 10.0
# A path decides what slides and what holds; the way's mesh would decide it.
_PATH_DEPENDENT = {Output.SHEAR, Output.MARKERS}


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrected:
    """What a press would give on preset reference, as far as is known."""

    force_n: float  # F_z at ``depth_m`` [N]
    depth_m: float  # depth at ``force_n`` [m]; one of the two is the press's own
    error_relative: float  # what may remain: of F_z if the depth was given, else of the depth
    bias_relative: float  # what was taken off F_z at the depth
    basis: str  # how it is known


def rules_of(scene: Scene) -> dict[float, BiasRule]:
    """Return what is known of a scene's bias, by the edges where it ends; empty for nothing."""
    if not _was_drawn(scene):
        return {}
    is_mesh = isinstance(scene.indenter, MeshIndenter)
    kind, _ = mesh_choice(replace(scene, preset=Preset.FAST))
    is_finer = is_mesh or scene.has_sharp_rim or kind is MeshKind.FOOTPRINT
    is_tilted_punch = kind is MeshKind.FOOTPRINT and scene.has_sharp_rim
    left_out = set() if (is_mesh or is_tilted_punch) and not scene.layers else {0.6}
    is_ball = isinstance(scene.indenter, Sphere)
    if not is_ball or scene.contact is ContactMode.FRICTION:  # punches vary more there
        left_out.add(1.4)
    at_edges = _AT_TILTED_EDGES if is_tilted_punch else _AT_EDGES
    at_edges = _AT_EDGES_LAYERED if scene.layers else at_edges
    rules = at_edges if is_finer else _RULES
    return {edges: rule for edges, rule in rules.items() if edges not in left_out}


def _was_drawn(scene: Scene) -> bool:
    """Return whether scenes of this kind were drawn: others may be off by more."""
    holds = scene.contact is ContactMode.FRICTION and scene.friction > 0.0
    stiffness = [material.young_pa for material in scene.materials]
    return (
        isinstance(scene.indenter, Sphere | Cylinder | MeshIndenter)
        and not isinstance(scene.pad, SurfacePad)
        and scene.contact is not ContactMode.BONDED
        and LawName.PAPER_EQ4 not in {material.law for material in scene.materials}
        and max(stiffness) <= _LAYERS_APART * min(stiffness)
        and 0.0 < expected_depth(scene) <= _DEEPEST_SHARE * scene.pad.height_m
        and not (holds and _PATH_DEPENDENT & scene.outputs)
    )


def corrected_settings(scene: Scene) -> dict[Setting, RelativeCost]:
    """Return every setting whose bias is known, the cheapest first, with what will be stated."""
    way = WAY_WITH_FRICTION if scene.contact is ContactMode.FRICTION else WAY
    return {
        Setting(Preset.FAST, edges, way if edges >= 1.0 else WAY * edges): RelativeCost(
            rule.time_ratio, rule.rest(scene)
        )
        for edges, rule in rules_of(scene).items()
    }


def correction(
    scene: Scene, plan: EffectPlan, found: PressOutputs, way: PressOutputs | None
) -> Corrected | None:
    """Return the corrected force and depth of an end state; None where no bias is known.

    Args:
        found: Of the end state.
        way: Of the way's mesh, at the same depth or force; None where there was none.
    """
    rule = rules_of(scene).get(scene.refinement) if scene.preset is Preset.FAST else None
    force, depth = float(found.force_n[2]), found.depth_m
    if way is None or rule is None or depth > _DEEPEST_SHARE * scene.pad.height_m:
        return None
    if not force > 0.0 or not found.stiffness_n_m > 0.0:
        return None
    bias = rule.bias(scene)
    left = rule.rest(scene) + plan.left_out(Output.FORCE)
    missing = bias / (1.0 + bias)
    if scene.target.force_n is None:
        force *= 1.0 - missing
    else:
        depth += missing * force / found.stiffness_n_m
        left *= min(1.0, force / (found.stiffness_n_m * depth))
    return Corrected(
        force_n=force,
        depth_m=depth,
        error_relative=left,
        bias_relative=bias,
        basis=f"{bias:.2%} of F_z at a depth was taken off, the bias that such meshes have",
    )
