"""Cases 4, 7, 8, 16 and 17: slivers and stiff layers, deep presses, and places of a press."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse
import scipy.sparse.linalg

from sim.effects.presets import build_model
from sim.fields.pressure_and_shear import contact_measures
from sim.mesh.cached_tet_mesh import TetMesh, smallest_dihedral_deg
from sim.mesh.elements import ElementOrder, boundary_faces
from sim.press import press
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import LawName, Layer, Material
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import Effect, Preset, Scene, Target
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases import small_pads
from sim.studies.hard_cases.small_pads import Measured
from sim.studies.verification.exact import BondedLayers
from sim.studies.verification.forces import measure_orders
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

SLIVER_DEG = 0.5
PUNCH = Cylinder(diameter_m=5e-3)
# A wide pad of linear gel without weight, as published and exact solutions have it.
_WIDE = Scene(
    pad=DiscPad(radius_m=40e-3, height_m=4e-3),
    material=Material(young_pa=3e5, poisson=0.48, law=LawName.LINEAR),
    indenter=PUNCH,
    target=Target(depth_m=10e-6),
    preset=Preset.FAST,
    barrier_m=1e-7,
    effects=((Effect.GRAVITY, False),),
)


def slivers(depth_m: float = 0.8e-3) -> Measured:
    """Press a ball into a brick with and without slivers, with both elements."""
    good = small_pads.brick_mesh((6, 6, 3))
    bad = with_slivers(good, dihedral_deg=SLIVER_DEG)
    measured: Measured = {"dihedral_min_deg": smallest_dihedral_deg(bad)}
    for order in ElementOrder:
        spent, force = _ball_press(good, order, depth_m)
        spent_bad, force_bad = _ball_press(bad, order, depth_m)
        measured[f"iterations_{order.value}"] = spent_bad
        measured[f"iterations_good_mesh_{order.value}"] = spent
        measured[f"iterations_over_good_mesh_{order.value}"] = spent_bad / spent
        measured[f"force_difference_relative_{order.value}"] = force_bad / force - 1.0
    return measured


def _ball_press(mesh: TetMesh, order: ElementOrder, depth_m: float) -> tuple[int, float]:
    path = LoadingPath(small_pads.pad_model(mesh, order=order), Sphere(diameter_m=8e-3))
    point = path.advance(depth_m)
    return path.counts.newton_iterations, float(point.force_n[2])


def stiff_layers() -> Measured:
    """Press flat punches into two layers, 10,000 times apart, either one on top."""
    skin = _laminate_press("soft_on_stiff", ratio=1e-4, share=0.925, radius_m=2.5e-3)
    return skin | _laminate_press("stiff_on_soft", ratio=1e4, share=0.5, radius_m=0.5e-3)


def _laminate_press(name: str, *, ratio: float, share: float, radius_m: float) -> Measured:
    """Press 10 um into a base and a top layer ``ratio`` times as stiff."""
    young, depth = 1e5 / min(1.0, ratio), 10e-6
    lower, upper = (replace(_WIDE.material, young_pa=each) for each in (young, young * ratio))
    layers = (Layer(share=share, material=lower), Layer(share=1.0 - share, material=upper))
    indenter = Cylinder(diameter_m=2.0 * radius_m)
    scene = replace(_WIDE, material=upper, layers=layers, indenter=indenter)
    result, solution = press(scene), BondedLayers.of_scene(scene)
    exact_n = solution.punch_force(radius_m=radius_m, depth_m=depth)
    residual_n = result.point.equilibrium.residual_n
    return {
        f"force_error_relative_{name}": result.force_n[2] / exact_n - 1.0,
        f"residual_relative_{name}": residual_n / result.force_n[2],
        f"iterations_{name}": result.newton_iterations,
    }


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
        flattened = TetMesh(vertices=moved, tets=star, name="star")
        return smallest_dihedral_deg(flattened) - dihedral_deg

    share = scipy.optimize.bisect(excess_deg, 0.0, 1.0, xtol=1e-12)
    return np.asarray(start + share * (goal - start))


_DEPTH_SHARE = 0.8
_FRAME_M = 0.1e-3


def deep_presses() -> Measured:
    """Press in 0.1 mm frames to 80 % of the height, in three ways."""
    # The stable law costs little at J = 0, and at a sharp rim it goes below; the other one cannot.
    finer: dict[str, Any] = {"size_m": 0.25e-3, "growth": 1.5, "sector_count": 12}
    slipping = press_in("rounded_slipping", fillet_m=0.5e-3, bonded=False, **finer)
    sticking = press_in("rounded_sticking", fillet_m=0.5e-3, bonded=True)
    sharp = press_in("sharp_sticking", bonded=True, law_name=LawName.NEO_HOOKEAN)
    return slipping | sticking | sharp


def press_in(
    name: str,
    *,
    bonded: bool,
    fillet_m: float = 0.0,
    size_m: float = 0.2e-3,
    law_name: LawName = LawName.STABLE_NEO_HOOKEAN,
    **mesh_options: Any,
) -> Measured:
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
    mesh = small_pads.round_mesh(**rim, **mesh_options)
    model = small_pads.pad_model(mesh, law_name=law_name, bonded=bonded)
    path = LoadingPath(model, indenter, step_max_m=_FRAME_M)
    forces, ratios = [0.0], [1.0]
    depth = _DEPTH_SHARE * small_pads.HEIGHT_M
    for at in np.linspace(0.0, depth, round(depth / _FRAME_M) + 1)[1:]:
        point = path.advance(float(at))
        forces.append(float(point.force_n[2]))
        ratios.append(point.equilibrium.min_jacobian)
    return {
        f"force_end_{name}_n": forces[-1],
        f"force_rise_min_{name}_n": float(np.diff(forces).min()),
        f"min_jacobian_{name}": min(ratios),
        f"newton_iterations_{name}": path.counts.newton_iterations,
    }


# --- Places on the pad.
PAD = BoxPad(size_x_m=12e-3, size_y_m=12e-3, height_m=4e-3)
INDENTERS: dict[str, Indenter] = {"sharp_cylinder": PUNCH, "sphere": small_pads.BALL}
PLACES = {"middle": (0.0, 0.0), "edge": (6e-3, 0.0), "corner": (6e-3, 6e-3)}
DEPTHS_M = (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3)
# Farther than the larger radius: a ball whose tip is beside the pad may still touch its edge.
_BESIDE_M = (10.5e-3, 0.0)


def off_the_pad(
    indenters: Mapping[str, Indenter] = INDENTERS, effects: tuple[tuple[Effect, bool], ...] = ()
) -> Measured:
    """Press at the middle, the edge and the corner of a box, then beside it.

    Every step that is reached has converged, or an error is raised.
    """
    measured, refused = Measured(), 0
    for name, indenter in indenters.items():
        scene = Scene(
            pad=PAD,
            material=Material(young_pa=4e5, poisson=0.48),
            indenter=indenter,
            target=Target(depth_m=DEPTHS_M[-1]),
            preset=Preset.FAST,
            effects=effects,
        )
        forces = []
        for place, centre in PLACES.items():
            found = _pressed_at(replace(scene, centre_m=centre))
            measured |= {f"{name}_{place}_{key}": value for key, value in found.items()}
            forces.append(float(found["force_n"]))
        measured[f"{name}_falls_outwards"] = forces[0] > forces[1] > forces[2] > 0.0
        try:
            press(replace(scene, centre_m=_BESIDE_M))
        except ConfigError as error:
            measured[f"{name}_beside"] = error.message
            refused += 1
        else:
            measured[f"{name}_beside"] = "pressed nothing without a word"
    return measured | {"bodies": len(indenters), "refused_beside": refused}


def _pressed_at(scene: Scene) -> Measured:
    model = build_model(scene)
    path = LoadingPath(model, scene.indenter, scene.centre_m)
    forces, balance, gap = [0.0], 0.0, np.inf
    for depth in DEPTHS_M:
        point = path.advance(depth)
        balance = max(balance, small_pads.balance_relative(model, point))
        gap = min(gap, contact_measures(model, point).gap_min_m)
        forces.append(float(point.force_n[2]))
    return {
        "force_n": forces[-1],
        "rises": bool(np.all(np.diff(forces) > 0.0)),
        "balance_max_relative": balance,
        "gap_min_m": gap,
        "min_jacobian": point.equilibrium.min_jacobian,
    }


_STRETCH = np.array([[1.08, 0.05, -0.03], [0.02, 0.93, 0.04], [0.01, -0.06, 1.05]])
_OBJECTIVE = (LawName.STABLE_NEO_HOOKEAN, LawName.NEO_HOOKEAN)
_REST_STABLE = (*_OBJECTIVE, LawName.LINEAR)
_NEWTON_STEPS = 8


def consistency_and_order() -> Measured:
    """Turn, stretch and refine."""
    return rigid_motion() | patch_test() | small_pads.numbers_of(measure_orders())


def _uneven_models(laws: Iterable[LawName]) -> Iterator[Model]:
    mesh = small_pads.brick_mesh((4, 4, 3), jitter=0.2)
    for order, name in product(ElementOrder, laws):
        yield small_pads.pad_model(mesh, order=order, law_name=name)


def rigid_motion() -> Measured:
    """Turn and shift an unloaded pad by much: energy and forces stay zero."""
    force, energy = 0.0, 0.0
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    for model in _uneven_models(_OBJECTIVE):
        moved = model.nodes @ turn.T + np.array([0.01, -0.02, 0.03])
        stored = abs(model.gel.energy(moved)[0])
        energy = max(energy, stored / (small_pads.YOUNG_PA * model.volume_m3))
        pull = float(np.abs(model.gel.gradient(moved)).max())
        force = max(force, pull / (small_pads.YOUNG_PA * small_pads.HEIGHT_M**2))
    return {"rigid_energy_over_E_volume": energy, "rigid_force_over_E_height2": force}


def patch_test() -> Measured:
    """Stretch the boundary affinely; the interior, found by Newton, must follow exactly."""
    distance = 0.0
    for model in _uneven_models(_REST_STABLE):
        expected = model.nodes @ _STRETCH.T
        found = _interior_equilibrium(model, expected)
        distance = max(distance, float(np.abs(found - expected).max()) / small_pads.HEIGHT_M)
    return {"patch_distance_over_height": distance}


def _interior_equilibrium(model: Model, boundary: FloatArray) -> FloatArray:
    """Solve for the interior nodes from a scattered start, the outer ones held."""
    outer = np.zeros((len(model.nodes), 3), dtype=np.bool_)
    outer[np.unique(boundary_faces(model.elements)[0])] = True
    inside = np.flatnonzero(~outer.reshape(-1)[model.pattern.free_dofs])
    dofs = model.pattern.free_dofs[inside]
    noise = np.random.default_rng(2).uniform(-0.01, 0.01, size=boundary.shape) * small_pads.HEIGHT_M
    positions = np.where(outer, boundary, boundary + noise)
    untouched = np.zeros((len(model.faces), len(model.reference.face_weights), 3, 3))
    for _ in range(_NEWTON_STEPS):
        gradient = model.gel.gradient(positions).reshape(-1)[dofs]
        data = model.hessian_data(positions, untouched, projected=False)
        upper = model.pattern.upper(data)
        matrix = (upper + scipy.sparse.triu(upper, 1).T).tocsr()[inside][:, inside]
        flat = positions.reshape(-1)
        flat[dofs] -= scipy.sparse.linalg.spsolve(matrix.tocsc(), gradient)
    return positions
