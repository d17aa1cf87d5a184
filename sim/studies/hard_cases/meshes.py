"""Cases 5, 16 and 17: a rim between nodes, the indenter beside the pad, refinement."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from sim.effects.presets import build_model
from sim.mesh.elements import ElementOrder, boundary_faces
from sim.mesh.tet_mesh import MirrorSymmetry, TetMesh
from sim.press import contact_measures, press
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import LawName, Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Effect, Preset, Scene, Target
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases import pads
from sim.studies.hard_cases.pads import Measured, Outcome
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

PUNCH = Cylinder(diameter_m=5e-3)
_SPREAD_ALLOWED = 0.05
SHIFTS = (0.0, 0.25, 0.5)
PAD = BoxPad(size_x_m=12e-3, size_y_m=12e-3, height_m=4e-3)
INDENTERS: dict[str, Indenter] = {
    "sharp_cylinder": Cylinder(diameter_m=5e-3),
    "sphere": Sphere(diameter_m=8e-3),
}
PLACES = {"middle": (0.0, 0.0), "edge": (6e-3, 0.0), "corner": (6e-3, 6e-3)}
DEPTHS_M = (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3)
_BALANCE_MAX = 1e-6
# Farther than the larger radius: a ball whose tip is beside the pad may still touch its edge.
_BESIDE_M = (10.5e-3, 0.0)


def moved_rim() -> Outcome:
    """Press where the rim meets nodes and up to half an element beside, on two kinds of mesh.

    One is uniform and knows nothing of the punch; the other is fine at the rim's first place.
    """
    uniform_m, rim_m = 1e-3, 0.2e-3
    fitted = pads.round_mesh(
        start_m=PUNCH.radius_m, end_m=PUNCH.radius_m, size_m=rim_m, symmetric=False
    )
    meshes = {"uniform": (uniform_mesh(uniform_m), uniform_m), "fitted": (fitted, rim_m)}
    measured: Measured = {}
    spreads = []
    for name, (mesh, size) in meshes.items():
        forces = forces_beside(mesh, size, depth_m=0.4e-3)
        spreads.append((max(forces) - min(forces)) / forces[0])
        measured[f"element_at_rim_{name}_m"] = size
        measured[f"force_spread_relative_{name}"] = spreads[-1]
        measured[f"force_{name}_n"] = forces[0]
    return Outcome(passed=max(spreads) < _SPREAD_ALLOWED, measured=measured)


def forces_beside(
    mesh: TetMesh, size_m: float, *, depth_m: float, shifts: tuple[float, ...] = SHIFTS
) -> list[float]:
    """Return F_z with the punch moved along x by shares of an element [N]."""
    model = pads.pad_model(mesh, order=ElementOrder.P2)
    paths = [LoadingPath(model, PUNCH, (share * size_m, 0.0)) for share in shifts]
    return [float(path.advance(depth_m).force_n[2]) for path in paths]


def uniform_mesh(size_m: float, *, extent_m: float = 10e-3) -> TetMesh:
    """Return one half, y >= 0, of a square pad of equal cells about as large as asked."""
    count = round(0.5 * extent_m / size_m)
    mesh = pads.box_mesh(
        (extent_m, 0.5 * extent_m, pads.HEIGHT_M), (2 * count, count, round(pads.HEIGHT_M / size_m))
    )
    raised = mesh.vertices + np.array([0.0, 0.25 * extent_m, 0.0])
    return replace(mesh, vertices=raised, symmetry=MirrorSymmetry(mirror_y=True))


def off_the_pad(
    indenters: Mapping[str, Indenter] = INDENTERS, effects: tuple[tuple[Effect, bool], ...] = ()
) -> Outcome:
    """Press at the middle, the edge and the corner of a box, then beside it.

    Every step that is reached has converged, or an error is raised.
    """
    measured, passed = Measured(), True
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
            passed &= bool(found["rises"]) and float(found["gap_min_m"]) > 0.0
            passed &= float(found["balance_max_relative"]) <= _BALANCE_MAX
            forces.append(float(found["force_n"]))
        passed &= forces[0] > forces[1] > forces[2] > 0.0
        try:
            press(replace(scene, centre_m=_BESIDE_M))
        except ConfigError as error:
            measured[f"{name}_beside"] = error.message
        else:
            measured[f"{name}_beside"], passed = "pressed nothing without a word", False
    return Outcome(passed=passed, measured=measured)


def _pressed_at(scene: Scene) -> Measured:
    model = build_model(scene)
    path = LoadingPath(model, scene.indenter, scene.centre_m)
    forces, balance, gap = [0.0], 0.0, np.inf
    for depth in DEPTHS_M:
        point = path.advance(depth)
        balance = max(balance, pads.balance_relative(model, point))
        gap = min(gap, contact_measures(path, point).gap_min_m)
        forces.append(float(point.force_n[2]))
    return {
        "force_n": forces[-1],
        "rises": bool(np.all(np.diff(forces) > 0.0)),
        "balance_max_relative": balance,
        "gap_min_m": gap,
        "min_jacobian": point.equilibrium.min_jacobian,
    }


_POISSON = 0.3
_STRETCH = np.array([[1.08, 0.05, -0.03], [0.02, 0.93, 0.04], [0.01, -0.06, 1.05]])
_OBJECTIVE = (LawName.STABLE_NEO_HOOKEAN, LawName.NEO_HOOKEAN)
_LINEAR = LawName.LINEAR
_REST_STABLE = (*_OBJECTIVE, _LINEAR)
_NEWTON_STEPS = 8


def consistency_and_order() -> Outcome:
    """Turn, stretch and refine."""
    measured = rigid_motion() | patch_test()
    exact = max(float(deviation) for deviation in measured.values())
    rim = sharp_rim_forces()
    rims = [float(order) for order in np.log2(np.diff(rim)[:-1] / np.diff(rim)[1:])]
    measured["sharp_rim_order_p1"] = rims[-1]
    measured["sharp_rim_orders_p1"] = ", ".join(f"{order:.2f}" for order in rims)
    sphere = {cells: sphere_force(cells, poisson=0.0) for cells in (2, 3, 4, 6, 8)}
    changes = [abs(sphere[2 * cells] - sphere[cells]) for cells in (2, 3, 4)]
    order = -float(np.polyfit(np.log([2, 3, 4]), np.log(changes), 1)[0])
    measured["sphere_order_p2"] = order
    measured["sphere_changes_p2"] = ", ".join(f"{change / sphere[8]:.1e}" for change in changes)
    edge = [sphere_force(cells, poisson=_POISSON) for cells in (4, 6, 9)]
    first, second = np.abs(np.diff(edge))
    measured[f"clamped_edge_order_p2_nu_{_POISSON:g}"] = float(np.log(first / second) / np.log(1.5))
    passed = exact <= 1e-10 and abs(rims[-1] - 1.0) <= 0.2 and order >= 1.8
    return Outcome(passed=passed, measured=measured)


def sharp_rim_forces() -> list[float]:
    """Return F_z [N] of linear elements bonded to a punch on half of the pad; five levels."""
    forces = []
    for level in (1, 2, 4, 8, 16):
        mesh = pads.box_mesh((8e-3, 1e-3, 4e-3), (8 * level, 1, 4 * level))
        terms: dict[str, Any] = {"poisson": _POISSON, "distance_m": 1e-6}
        model = pads.pad_model(mesh, order=ElementOrder.P1, law_name=_LINEAR, bonded=True, **terms)
        path = LoadingPath(model, Cylinder(diameter_m=2.0), centre_m=(-1.0, 0.0))
        forces.append(float(path.advance(1e-6).force_n[2]))
    return forces


def sphere_force(cells: int, *, poisson: float) -> float:
    """Return F_z [N] of quadratic elements under a large ball, so many to the pad's height."""
    mesh = pads.box_mesh((4e-3, 4e-3, 4e-3), (cells, cells, cells), quarter=True)
    model = pads.pad_model(mesh, law_name=_LINEAR, poisson=poisson, distance_m=5e-5)
    path = LoadingPath(model, Sphere(diameter_m=40e-3), step_max_m=0.2e-3)
    return float(path.advance(4e-4).force_n[2])


def _uneven_models(laws: Iterable[LawName]) -> Iterator[Model]:
    mesh = pads.brick_mesh((4, 4, 3), jitter=0.2)
    for order, name in product(ElementOrder, laws):
        yield pads.pad_model(mesh, order=order, law_name=name)


def rigid_motion() -> Measured:
    """Turn and shift an unloaded pad by much: energy and forces stay zero."""
    force, energy = 0.0, 0.0
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    for model in _uneven_models(_OBJECTIVE):
        moved = model.nodes @ turn.T + np.array([0.01, -0.02, 0.03])
        stored = abs(model.gel.energy(moved)[0])
        energy = max(energy, stored / (pads.YOUNG_PA * model.volume_m3))
        pull = float(np.abs(model.gel.gradient(moved)).max())
        force = max(force, pull / (pads.YOUNG_PA * pads.HEIGHT_M**2))
    return {"rigid_energy_over_E_volume": energy, "rigid_force_over_E_height2": force}


def patch_test() -> Measured:
    """Stretch the boundary affinely; the interior, found by Newton, must follow exactly."""
    distance = 0.0
    for model in _uneven_models(_REST_STABLE):
        expected = model.nodes @ _STRETCH.T
        found = _interior_equilibrium(model, expected)
        distance = max(distance, float(np.abs(found - expected).max()) / pads.HEIGHT_M)
    return {"patch_distance_over_height": distance}


def _interior_equilibrium(model: Model, boundary: FloatArray) -> FloatArray:
    """Solve for the interior nodes from a scattered start, the outer ones held."""
    outer = np.zeros((len(model.nodes), 3), dtype=np.bool_)
    outer[np.unique(boundary_faces(model.elements)[0])] = True
    inside = np.flatnonzero(~outer.reshape(-1)[model.pattern.free_dofs])
    dofs = model.pattern.free_dofs[inside]
    noise = np.random.default_rng(2).uniform(-0.01, 0.01, size=boundary.shape) * pads.HEIGHT_M
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
