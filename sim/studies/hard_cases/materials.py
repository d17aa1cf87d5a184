"""Cases 3, 4, 7 and 8: nearly incompressible gel, deep presses, slivers, stiff layers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.optimize

from sim.mesh.elements import ElementOrder, boundary_faces
from sim.mesh.tet_mesh import TetMesh, smallest_dihedral_deg
from sim.press import press
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName, Layer, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Effect, Preset, Scene, Target
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases import pads
from sim.studies.hard_cases.pads import Measured, Outcome
from sim.studies.verification.exact import BondedLayers
from tacauchy_rig.core.arrays import FloatArray, IntArray

# Hayes et al. 1972 at a / h = 0.5556.
HAYES_FACTORS = {0.45: 1.930, 0.47: 1.983, 0.49: 2.048, 0.499: 2.081}
FORCE_TOLERANCE = 0.05
RESIDUAL_TOLERANCE = 1e-6
SLIVER_DEG = 0.5
ITERATION_RATIO = 3.0
# A wide pad of linear gel without weight, as published and exact solutions have it.
_WIDE = Scene(
    pad=DiscPad(radius_m=40e-3, height_m=4e-3),
    material=Material(young_pa=3e5, poisson=0.48, law=LawName.LINEAR),
    indenter=Cylinder(diameter_m=5e-3),
    target=Target(depth_m=10e-6),
    preset=Preset.FAST,
    barrier_m=1e-7,
    effects=((Effect.GRAVITY, False),),
)


def nearly_incompressible() -> Outcome:
    """Press a flat punch 20 um into a wide layer at every nu that has a published force."""
    young, radius, depth = _WIDE.material.young_pa, 2.5e-3, 20e-6
    layer = replace(_WIDE, pad=DiscPad(radius_m=40e-3, height_m=4.5e-3), preset=Preset.BALANCED)
    errors: dict[str, float] = {}
    for poisson, factor in HAYES_FACTORS.items():
        gel = replace(_WIDE.material, poisson=poisson)
        force = press(replace(layer, material=gel, target=Target(depth_m=depth))).force_n[2]
        expected = 2.0 * radius * young * depth * factor / (1.0 - poisson**2)
        errors[f"force_error_relative_nu_{poisson:g}"] = force / expected - 1.0
    worst = max(map(abs, errors.values()))
    return Outcome(passed=worst < FORCE_TOLERANCE, measured={**errors})


def slivers(depth_m: float = 0.8e-3) -> Outcome:
    """Press a ball into a brick with and without slivers, with both elements."""
    good = pads.brick_mesh((6, 6, 3))
    bad = with_slivers(good, dihedral_deg=SLIVER_DEG)
    measured: Measured = {
        "dihedral_min_deg": smallest_dihedral_deg(bad),
        "sliver_count": sliver_count(bad, below_deg=1.01 * SLIVER_DEG),
    }
    worst = 0.0
    for order in ElementOrder:
        spent, force = _ball_press(good, order, depth_m)
        spent_bad, force_bad = _ball_press(bad, order, depth_m)
        measured[f"iterations_{order.value}"] = spent_bad
        measured[f"iterations_good_mesh_{order.value}"] = spent
        measured[f"force_difference_relative_{order.value}"] = force_bad / force - 1.0
        worst = max(worst, spent_bad / spent)
    return Outcome(passed=worst <= ITERATION_RATIO, measured=measured)


def _ball_press(mesh: TetMesh, order: ElementOrder, depth_m: float) -> tuple[int, float]:
    path = LoadingPath(pads.pad_model(mesh, order=order), Sphere(diameter_m=8e-3))
    point = path.advance(depth_m)
    return path.counts.newton_iterations, float(point.force_n[2])


def stiff_layers() -> Outcome:
    """Press flat punches into two layers, 10,000 times apart, either one on top."""
    skin = _laminate_press("soft_on_stiff", ratio=1e-4, share=0.925, radius_m=2.5e-3)
    base = _laminate_press("stiff_on_soft", ratio=1e4, share=0.5, radius_m=0.5e-3)
    return Outcome(passed=skin.passed and base.passed, measured=skin.measured | base.measured)


def _laminate_press(name: str, *, ratio: float, share: float, radius_m: float) -> Outcome:
    """Press 10 um into a base and a top layer ``ratio`` times as stiff."""
    young, depth = 1e5 / min(1.0, ratio), 10e-6
    lower, upper = (replace(_WIDE.material, young_pa=each) for each in (young, young * ratio))
    layers = (Layer(share=share, material=lower), Layer(share=1.0 - share, material=upper))
    indenter = Cylinder(diameter_m=2.0 * radius_m)
    result = press(replace(_WIDE, material=upper, layers=layers, indenter=indenter))
    solution = BondedLayers.of_pad(layers, height_m=_WIDE.pad.height_m)
    error = result.force_n[2] / solution.punch_force(radius_m=radius_m, depth_m=depth) - 1.0
    residual = result.point.equilibrium.residual_n / result.force_n[2]
    return Outcome(
        passed=abs(error) < FORCE_TOLERANCE and residual < RESIDUAL_TOLERANCE,
        measured={
            f"force_error_relative_{name}": error,
            f"residual_relative_{name}": residual,
            f"iterations_{name}": result.newton_iterations,
        },
    )


def with_slivers(mesh: TetMesh, *, dihedral_deg: float) -> TetMesh:
    """Flatten one tetrahedron at every other interior node, those with no edge in common."""
    vertices = mesh.vertices.copy()
    inner = np.setdiff1d(np.arange(len(vertices)), np.unique(boundary_faces(mesh.tets)[0]))
    taken: set[int] = set()
    for node in inner.tolist():
        star = mesh.tets[np.any(mesh.tets == node, axis=1)]
        if node not in taken:
            vertices[node] = _flattening_place(vertices, star, node, dihedral_deg)
            taken.update(star.reshape(-1).tolist())
    name = f"{mesh.name}, slivers of {dihedral_deg:g} deg"
    return replace(mesh, vertices=vertices, name=name)


def sliver_count(mesh: TetMesh, *, below_deg: float) -> int:
    """Return how many tetrahedra have an angle between two faces below a limit."""
    return sum(_smallest_angle(mesh.vertices, tet[None]) < below_deg for tet in mesh.tets)


def _flattening_place(
    vertices: FloatArray, star: IntArray, node: int, dihedral_deg: float
) -> FloatArray:
    """Return where a node flattens a tetrahedron as asked, towards the middle of its other face."""
    start = vertices[node].copy()
    opposite = star[0][star[0] != node]
    goal = vertices[opposite].mean(axis=0)
    moved = vertices.copy()

    def excess_deg(share: float) -> float:
        moved[node] = start + share * (goal - start)
        return _smallest_angle(moved, star) - dihedral_deg

    share = scipy.optimize.bisect(excess_deg, 0.0, 1.0, xtol=1e-12)
    return np.asarray(start + share * (goal - start))


def _smallest_angle(vertices: FloatArray, tets: IntArray) -> float:
    return smallest_dihedral_deg(TetMesh(vertices=vertices, tets=tets, name="star"))


_DEPTH_SHARE = 0.8
_FRAME_M = 0.1e-3


def deep_presses() -> Outcome:
    """Press in 0.1 mm frames to 80 % of the height, in three ways."""
    # The stable law costs little at J = 0, and at a sharp rim it goes below; the other one cannot.
    finer: dict[str, Any] = {"size_m": 0.25e-3, "growth": 1.5, "sector_count": 12}
    slipping = press_in("rounded_slipping", fillet_m=0.5e-3, bonded=False, **finer)
    sticking = press_in("rounded_sticking", fillet_m=0.5e-3, bonded=True)
    sharp = press_in("sharp_sticking", bonded=True, law_name=LawName.NEO_HOOKEAN)
    return Outcome(
        passed=slipping.passed and sticking.passed and sharp.passed,
        measured=slipping.measured | sticking.measured | sharp.measured,
    )


def press_in(
    name: str,
    *,
    bonded: bool,
    fillet_m: float = 0.0,
    size_m: float = 0.2e-3,
    law_name: LawName = LawName.STABLE_NEO_HOOKEAN,
    **mesh_options: Any,
) -> Outcome:
    """Press a disc pad, 20 mm wide, to 80 % of its 4 mm with a 5 mm cylinder, frame by frame.

    Args:
        name: In the names of what is measured.
        bonded: The gel sticks to the cylinder; otherwise it slips freely.
        size_m: Edge length at the rim [m].
        mesh_options: Of ``round_mesh``.
    """
    indenter = Cylinder(diameter_m=5e-3, fillet_m=fillet_m)
    radius = indenter.radius_m
    rim: dict[str, Any] = {"start_m": radius - fillet_m, "end_m": radius, "size_m": size_m}
    mesh = pads.round_mesh(**rim, **mesh_options)
    model = pads.pad_model(mesh, law_name=law_name, bonded=bonded)
    path = LoadingPath(model, indenter, step_max_m=_FRAME_M)
    forces, ratios = [0.0], [1.0]
    depth = _DEPTH_SHARE * pads.HEIGHT_M
    for at in np.linspace(0.0, depth, round(depth / _FRAME_M) + 1)[1:]:
        point = path.advance(float(at))
        forces.append(float(point.force_n[2]))
        ratios.append(point.equilibrium.min_jacobian)
    rise = float(np.diff(forces).min())
    return Outcome(
        passed=rise > 0.0,
        measured={
            f"force_end_{name}_n": forces[-1],
            f"force_rise_min_{name}_n": rise,
            f"min_jacobian_{name}": min(ratios),
            f"newton_iterations_{name}": path.counts.newton_iterations,
        },
    )
