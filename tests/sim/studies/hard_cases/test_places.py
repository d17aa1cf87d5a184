"""Cases 5 and 16 in their fast form: a shallower press, linear elements."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.elements import boundary_faces
from sim.scene.scene import Effect
from sim.studies.hard_cases.meshes import INDENTERS, forces_beside, pressed_off, uniform_mesh

LINEAR = ((Effect.LOCKING_FREE_ELEMENT, False),)


def test_uniform_mesh_is_half_a_pad() -> None:
    """It lies at y >= 0, fills its half, and has its mirror plane's faces."""
    mesh = uniform_mesh(2e-3)
    assert mesh.symmetry.copies == 2
    assert mesh.vertices[:, 1].min() == pytest.approx(0.0, abs=1e-15)
    corners = mesh.vertices[mesh.tets]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert 2.0 * volumes.sum() == pytest.approx(10e-3 * 10e-3 * 4e-3, rel=1e-12)
    faces, _ = boundary_faces(mesh.tets)
    assert np.any(np.all(np.abs(mesh.vertices[faces][:, :, 1]) <= 1e-15, axis=1))


def test_force_hardly_depends_on_where_the_rim_meets_elements() -> None:
    """Half of a 1 mm element along x changes F by less than 5 %."""
    on, beside = forces_beside(uniform_mesh(1e-3), 1e-3, depth_m=0.05e-3, shifts=(0.0, 0.5))
    assert on > 0.1
    assert beside == pytest.approx(on, rel=0.05)


@pytest.mark.slow
def test_sharp_rim_off_the_pad() -> None:
    """Half off and on a corner it balances and rises; beside the pad the message says where."""
    indenters = {"cylinder": INDENTERS["sharp_cylinder"]}
    found = pressed_off(indenters, effects=LINEAR)
    assert found.passed, found.measured
    forces = [float(found.measured[f"cylinder_{p}_force_n"]) for p in ("middle", "edge", "corner")]
    # Half and a quarter of the face touch, on gel that has less around it.
    assert 0.2 < forces[1] / forces[0] < 0.5
    assert 0.05 < forces[2] / forces[0] < 0.25
    assert "beside the pad" in str(found.measured["cylinder_beside"])
