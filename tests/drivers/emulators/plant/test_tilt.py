"""The response to a tilt, against other ways to the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.emulators.plant.axisymmetric import Equilibrium, GelSolver
from drivers.emulators.plant.quad_mesh import Grading, mesh_disc
from drivers.emulators.plant.tilt import TiltResponse, tilt_response
from drivers.emulators.plant.tips import CylinderTip
from drivers.emulators.plant.truth import GelDisc

TIP = CylinderTip(diameter_m=2e-3, fillet_m=5e-5)
GEL = GelDisc(radius_m=20e-3, thickness_m=20e-3, dome_radius_m=np.inf)
GRADING = Grading(fine_from_m=0.8e-3, fine_to_m=1.05e-3, fine_size_m=2.5e-5)
DEPTH_M = 1e-5


def _pressed(friction: float) -> tuple[Equilibrium, TiltResponse, float]:
    """Return a shallow press into a thick gel, its tilt, and dF/d(depth)."""
    solver = GelSolver(mesh_disc(GEL, GRADING), TIP, poisson=0.3, friction=friction)
    state = Equilibrium(displacement=np.zeros_like(solver.mesh.nodes))
    forces = []
    for depth in (0.5 * DEPTH_M, DEPTH_M):
        state = solver.press(GEL.thickness_m - depth, state.displacement, grip=state.grip)
        forces.append(state.force)
    tilt = tilt_response(solver, state)
    return state, tilt, (forces[1] - forces[0]) / (0.5 * DEPTH_M)


def test_a_thick_gel_answers_as_a_half_space_does() -> None:
    """Rigid disc of radius a on a half-space: moment over force stiffness is 2/3 a^2 (Johnson)."""
    state, tilt, stiffness = _pressed(friction=0.0)
    radius_m = state.contact_radius_m
    assert tilt.moment == pytest.approx(2.0 / 3.0 * radius_m**2 * stiffness, rel=0.06)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_gel_follows_the_face(friction: float) -> None:
    """Where the face touches, the gel goes down on the side that it tilts to, by tilt times r."""
    mesh = mesh_disc(GEL, GRADING)
    _, tilt, _ = _pressed(friction)
    top = np.unique(mesh.top_edges)
    inside = top[(mesh.nodes[top, 0] > 0.1e-3) & (mesh.nodes[top, 0] < 0.85e-3)]
    np.testing.assert_allclose(tilt.displacement[inside, 1], -mesh.nodes[inside, 0], rtol=0.03)
