"""The paper's model as it states it, pressed beside ours, and the numbers of its mesh's table."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sim.effects.effect_choice import plan_effects
from sim.effects.presets import PAPER_SIZING, build_model, mesh_for
from sim.effects.press_with_effects import follow, path_for
from sim.fields.stress import surface_stress
from sim.mesh.cached_tet_mesh import TetMesh, mesh_key, stored_mesh
from sim.mesh.elements import boundary_faces
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.press import PressResult, measure, press
from sim.press_arguments import scene_from
from sim.scene.material import LawName
from sim.scene.scene import Drive, Preset, Scene, Target

# The contact surface's edges are measured so near the pad's middle [m] and above this share of its
# height (paper, section IV-A).
_CENTRE_M = 2.5e-3
_UPPER_SHARE = 0.8


def mesh_statistics(mesh: TetMesh) -> dict[str, float]:
    """Measure a mesh as the paper's section IV-A does.

    Returns:
        By the claim's name counts, and as ``edge`` the mean length of the contact surface's edges
        within 2.5 mm of the middle [mm].
    """
    (faces, _), vertices = boundary_faces(mesh.tets), mesh.vertices
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    middles = vertices[edges].mean(axis=1)
    centre = np.hypot(middles[:, 0], middles[:, 1]) < _CENTRE_M
    kept = edges[centre & (middles[:, 2] > _UPPER_SHARE * vertices[:, 2].max())]
    lengths = np.linalg.norm(vertices[kept[:, 0]] - vertices[kept[:, 1]], axis=1)
    return {
        "tets": len(mesh.tets),
        "vertices": len(vertices),
        "surface_vertices": len(np.unique(faces)),
        "surface_faces": len(faces),
        "edge": 1e3 * float(lengths.mean()) if len(lengths) else float("nan"),
    }


def mesh_numbers() -> dict[str, float]:
    """Return the numbers of preset paper's mesh, with its fine region and without it, by claim."""
    scene = scenes()[THIN]
    fine = mesh_for(scene)
    sizing: WildSizing = replace(PAPER_SIZING, fine_m=PAPER_SIZING.coarse_m)
    key = mesh_key(scene.pad, sizing)
    name = f"fTetWild, unrefined, {key}"
    coarse = stored_mesh("paper-unrefined", key, lambda: wild_mesh(scene.pad, sizing, name=name))
    plain, found = mesh_statistics(coarse), mesh_statistics(fine)
    found |= {f"{name}_plain": plain[name] for name in ("tets", "edge")}
    found["growth"] = found["tets"] / plain["tets"]
    found["density"] = (plain["edge"] / found["edge"]) ** 2
    return {f"mesh.{name}": value for name, value in found.items()}


# Its punch and friction; the rim's fillet and the gel's modulus, which it does not state, are ours.
PUNCH = (
    "--sensor gelsight-mini --indenter cylinder:diameter=5mm,fillet=0.1mm --contact friction:0.5"
)
# d_hat of section III-B [m].
BARRIER_M = 1e-3
# The paper names the ends of six forces (IV-B); those between are evenly spaced, as in a run [N].
FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)
# Where F_z of all models is compared [m].
DEPTH_M = 0.5e-3


Pressed = dict[str, float]
"""What one press gave: F_z, how far it is off the force that was asked for, the travel below first
touch (d_hat above the gel), the closest gap, the contact's radius, and sigma n summed over the
contact off the contact force, as a share."""
ModelPresses = dict[str, Any]
"""One model by ``name``, pressed ``DEPTH_M`` deep as ``at_depth``, and to each force as
``at_forces``."""


def every_press(model: ModelPresses) -> list[Pressed]:
    """Return all presses of a model."""
    return [model["at_depth"], *model["at_forces"]]


AS_CONFIGURED = "the paper's, as configured: d_hat 1 mm"
THIN = "its mesh, our d_hat"
FAST, BALANCED, ACCURATE = "our fast", "our balanced", "our accurate"


def scenes() -> dict[str, Scene]:
    """Return the models by name, each as a scene without its own target."""
    base = scene_from(f"{PUNCH} --depth {DEPTH_M * 1e3:g}mm --preset fast")
    paper = replace(base, preset=Preset.PAPER)
    return {
        AS_CONFIGURED: replace(paper, barrier_m=BARRIER_M),
        THIN: paper,
        FAST: base,
        BALANCED: replace(base, preset=Preset.BALANCED),
        ACCURATE: replace(base, preset=Preset.ACCURATE),
    }


def pressed(name: str, *, forces_n: Sequence[float] = FORCES_N) -> ModelPresses:
    """Press a model to the depth, and anew to each force by moving the indenter as the paper does.

    Forces rise [N]; each press goes on from the one before.
    """
    scene = scenes()[name]
    return {
        "name": name,
        "at_depth": _found(press(replace(scene, target=Target(depth_m=DEPTH_M)))),
        "at_forces": list(_at_forces(scene, forces_n)),
    }


def _at_forces(scene: Scene, forces_n: Sequence[float]) -> Iterator[Pressed]:
    plan = plan_effects(scene)
    path = path_for(scene, plan)
    before = 0
    for force in forces_n:
        wanted = replace(scene, target=Target(force_n=force), drive=Drive.SEARCH)
        result = measure(wanted, path, follow(wanted, path), plan=plan, wall_s={})
        yield _found(result) | {
            "off_n": abs(result.force_n[2] - force),
            "newton_iterations": result.newton_iterations - before,
        }
        before = result.newton_iterations


def _found(result: PressResult) -> Pressed:
    return {
        "force_n": result.force_n[2],
        "off_n": 0.0,
        "depth_m": result.depth_m,
        "gap_m": result.gap_min_m,
        "radius_m": result.contact_radius_m,
        "sigma_off": result.surface_traction_gap_relative,
        "newton_iterations": result.newton_iterations,
    }


def rest_stress_pa(law: LawName) -> float:
    """Return the normal stress that a law leaves in the gel at rest, by Algorithm 1 [Pa]."""
    scene = scenes()[THIN]
    model = build_model(replace(scene, material=replace(scene.material, law=law)))
    return float(np.median(surface_stress(model, model.nodes).normal_pa))
