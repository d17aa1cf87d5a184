"""Case 17: consistency, and how fast the force converges under uniform refinement.

Both meshes are regular, and each is the one before with every edge halved. A punch so wide that its
rim is straight across the pad gives a sharp rim that lies on nodes at every level. It goes in by no
more than a fraction of the finest element, so that the free surface is not drawn against its side,
which would be another problem at every level.

The ball is refined at nu = 0, where the base's clamped edge is next to not singular; the order is
that of the changes of F_z when 2, 3 and 4 elements to the height are halved. Finer still, what is
left is where the contact's edge happens to lie between quadrature points, a few 1e-4. At nu = 0.3
the clamped edge holds the order down once the ball is resolved; that order is reported.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from sim.contact.state import ContactOptions
from sim.mesh.elements import ElementOrder, boundary_faces
from sim.mesh.tet_mesh import TetMesh
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases.case import Measured, Outcome
from sim.studies.hard_cases.pads import HEIGHT_M, YOUNG_PA, box_mesh, brick_mesh, pad_model
from tacauchy_rig.core.arrays import FloatArray

_POISSON = 0.3
_STRETCH = np.array([[1.08, 0.05, -0.03], [0.02, 0.93, 0.04], [0.01, -0.06, 1.05]])
_OBJECTIVE = (LawName.STABLE_NEO_HOOKEAN, LawName.NEO_HOOKEAN)
_REST_STABLE = (*_OBJECTIVE, LawName.LINEAR)
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
        mesh = box_mesh((8e-3, 1e-3, 4e-3), (8 * level, 1, 4 * level))
        model = _linear(mesh, ElementOrder.P1, barrier_m=1e-6, bonded=True)
        path = LoadingPath(model, Cylinder(diameter_m=2.0), centre_m=(-1.0, 0.0))
        forces.append(float(path.advance(1e-6).force_n[2]))
    return forces


def sphere_force(cells: int, *, poisson: float) -> float:
    """Return F_z [N] of quadratic elements under a large ball, so many to the pad's height."""
    mesh = box_mesh((4e-3, 4e-3, 4e-3), (cells, cells, cells), quarter=True)
    model = _linear(mesh, ElementOrder.P2, barrier_m=5e-5, poisson=poisson)
    path = LoadingPath(model, Sphere(diameter_m=40e-3), step_max_m=0.2e-3)
    return float(path.advance(4e-4).force_n[2])


def _linear(
    mesh: TetMesh,
    order: ElementOrder,
    *,
    barrier_m: float,
    poisson: float = _POISSON,
    bonded: bool = False,
) -> Model:
    return pad_model(
        mesh,
        order=order,
        poisson=poisson,
        law_name=LawName.LINEAR,
        contact_options=ContactOptions(distance_m=barrier_m, bonded=bonded),
    )


def rigid_motion() -> Measured:
    """Turn and shift an unloaded pad by much: energy and forces stay zero."""
    force, energy = 0.0, 0.0
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    for order in ElementOrder:
        for name in _OBJECTIVE:
            model = pad_model(brick_mesh((4, 4, 3), jitter=0.2), order=order, law_name=name)
            moved = model.nodes @ turn.T + np.array([0.01, -0.02, 0.03])
            stored = abs(model.gel.energy(moved)[0])
            energy = max(energy, stored / (YOUNG_PA * model.volume_m3))
            pull = float(np.abs(model.gel.gradient(moved)).max())
            force = max(force, pull / (YOUNG_PA * HEIGHT_M**2))
    return {"rigid_energy_over_E_volume": energy, "rigid_force_over_E_height2": force}


def patch_test() -> Measured:
    """Stretch the boundary affinely; the interior, found by Newton, must follow exactly."""
    distance = 0.0
    for order in ElementOrder:
        for name in _REST_STABLE:
            model = pad_model(brick_mesh((4, 4, 3), jitter=0.2), order=order, law_name=name)
            expected = model.nodes @ _STRETCH.T
            found = _interior_equilibrium(model, expected)
            distance = max(distance, float(np.abs(found - expected).max()) / HEIGHT_M)
    return {"patch_distance_over_height": distance}


def _interior_equilibrium(model: Model, boundary: FloatArray) -> FloatArray:
    """Solve for the interior nodes from a scattered start, the outer ones held."""
    outer = np.zeros((len(model.nodes), 3), dtype=np.bool_)
    outer[np.unique(boundary_faces(model.elements)[0])] = True
    inside = np.flatnonzero(~outer.reshape(-1)[model.pattern.free_dofs])
    dofs = model.pattern.free_dofs[inside]
    noise = np.random.default_rng(2).uniform(-0.01, 0.01, size=boundary.shape) * HEIGHT_M
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
