"""Case 17, first half: rigid motion and the patch test."""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from sim.arrays import FloatArray
from sim.mesh.elements import ElementOrder, boundary_faces
from sim.scene.material import LawName
from sim.solve.model import Model
from sim.studies.hard_cases.case import Measured
from sim.studies.hard_cases.pads import HEIGHT_M, YOUNG_PA, brick_mesh, pad_model

_STRETCH = np.array([[1.08, 0.05, -0.03], [0.02, 0.93, 0.04], [0.01, -0.06, 1.05]])
_OBJECTIVE = (LawName.STABLE_NEO_HOOKEAN, LawName.NEO_HOOKEAN)
_REST_STABLE = (*_OBJECTIVE, LawName.LINEAR)
_NEWTON_STEPS = 8


def rigid_motion() -> Measured:
    """Turn and shift an unloaded pad by much: energy and forces stay zero."""
    force, energy = 0.0, 0.0
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    for order in ElementOrder:
        for name in _OBJECTIVE:
            model = pad_model(brick_mesh((4, 4, 3), jitter=0.2), order=order, law_name=name)
            moved = model.nodes @ turn.T + np.array([0.01, -0.02, 0.03])
            stored = abs(model.elastic_energy(moved)[0])
            energy = max(energy, stored / (YOUNG_PA * model.volume_m3))
            pull = float(np.abs(model.elastic_gradient(moved)).max())
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
    shape = (model.pattern.dof_count, model.pattern.dof_count)
    untouched = np.zeros((len(model.faces), len(model.reference.face_weights), 3, 3))
    for _ in range(_NEWTON_STEPS):
        gradient = model.elastic_gradient(positions).reshape(-1)[dofs]
        data = model.hessian_data(positions, untouched, projected=False)
        upper = scipy.sparse.csr_matrix((data, model.pattern.indices, model.pattern.indptr), shape)
        matrix = (upper + scipy.sparse.triu(upper, 1).T).tocsr()[inside][:, inside]
        flat = positions.reshape(-1)
        flat[dofs] -= scipy.sparse.linalg.spsolve(matrix.tocsc(), gradient)
    return positions
