"""Presses a tip into the gel step by step, and tabulates what it does."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from drivers.emulators.plant.axisymmetric import Equilibrium, GelSolver, TiltResponse, tilt_response
from drivers.emulators.plant.quad_mesh import Grading, PressCase, QuadMesh, line_shape, mesh_disc
from drivers.emulators.plant.tips import CylinderTip
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError

_DEPTH_STEP_M = 4e-5
_FIRST_DEPTHS_M = (5e-6, 1e-5, 2e-5)
_POINTS_PER_EDGE = 4
_CUT_LIMIT = 3


def tabulate(case: PressCase) -> dict[str, FloatArray]:
    """Press in steps; return the fields of a ``PressTable``."""
    mesh, top_m = mesh_disc(case.gel, _grading(case)), case.gel.thickness_m
    solver = GelSolver(mesh, case.tip, poisson=case.poisson, friction=case.friction)
    depth_count = round(case.max_depth_m / _DEPTH_STEP_M)
    regular = np.linspace(0.0, case.max_depth_m, depth_count + 1)[1:].tolist()
    solved = [0.0]
    states = [Equilibrium(displacement=np.zeros_like(mesh.nodes))]
    tilts = [TiltResponse(displacement=np.zeros_like(mesh.nodes))]
    for depth in [*(first for first in _FIRST_DEPTHS_M if first < 0.9 * regular[0]), *regular]:
        try:
            states.append(_advance(solver, top_m, solved, states, depth))
        except ConvergenceError:
            if depth < 0.5 * case.max_depth_m:
                raise
            break
        solved.append(depth)
        if case.has_face:
            tilts.append(tilt_response(solver, states[-1]))
    rest = _on_surface(mesh, mesh.nodes)
    force = np.array([state.force for state in states])
    table = {
        "depths": np.array(solved),
        "force": force,
        "stiffness": CubicSpline(solved, force)(solved, 1),
        "contact_radius": np.array([state.contact_radius_m for state in states]),
        "radius_rest": rest[:, 0],
        "height_rest": rest[:, 1] - top_m,
        "displacement": np.stack([_on_surface(mesh, each.displacement) for each in states]),
    }
    if case.has_face:
        table["tilt_displacement"] = np.stack(
            [_on_surface(mesh, tilt.displacement) for tilt in tilts]
        )
        table["moment"] = np.array([tilt.moment for tilt in tilts])
        table["side_force"] = np.array([tilt.side_force for tilt in tilts])
    return table


def _advance(
    solver: GelSolver, top_m: float, solved: list[float], states: list[Equilibrium], depth: float
) -> Equilibrium:
    """Go from the last solved depth to ``depth``, extrapolating first, then in smaller steps."""
    last = ahead = states[-1].displacement
    if len(states) > 1:
        ratio = (depth - solved[-1]) / (solved[-1] - solved[-2])
        ahead = last + ratio * (last - states[-2].displacement)
    tries = [(ahead, 1), *((last, 2**cut) for cut in range(_CUT_LIMIT))]
    for start, step_count in tries:
        state, grip = start, states[-1].grip
        try:
            for step_depth in np.linspace(solved[-1], depth, step_count + 1)[1:].tolist():
                found = solver.press(top_m - step_depth, state, grip=grip)
                state, grip = found.displacement, found.grip
        except ConvergenceError as error:
            failure = error
        else:
            return found
    raise failure


def _grading(case: PressCase) -> Grading:
    if isinstance(case.tip, CylinderTip):
        rim = 0.5 * case.tip.diameter_m
        return Grading(
            fine_from_m=rim - min(0.4e-3 * case.max_depth_m / 1e-3, 0.6 * rim),
            fine_to_m=rim + 5e-5,
            fine_size_m=max(0.3 * case.tip.fillet_m, 2.5e-5),
        )
    reach = min(np.sqrt(case.tip.diameter_m * case.max_depth_m), 0.5 * case.tip.diameter_m)
    return Grading(
        fine_from_m=0.0, fine_to_m=1.1 * reach, fine_size_m=reach / 18, top_size_m=reach / 14
    )


def _on_surface(mesh: QuadMesh, nodal: FloatArray) -> FloatArray:
    """Return a nodal field along the quadratic edges of the top, axis outwards."""
    shape, _ = line_shape(np.linspace(-1.0, 1.0, _POINTS_PER_EDGE + 1)[:-1])
    inner = np.einsum("qi,eia->eqa", shape, nodal[mesh.top_edges])
    return np.vstack([inner.reshape(-1, 2), nodal[mesh.top_edges[-1, 2]]])
