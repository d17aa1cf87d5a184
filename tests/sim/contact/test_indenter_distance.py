"""The gap to a body of triangles on the device, against the formula of what it approximates."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Indenter, cylinder_triangles, mesh_indenter, tilted
from sim.solve.model import Model
from sim.studies.hard_cases.pads import brick_mesh, pad_model
from tacauchy_rig.core.arrays import FloatArray

PUNCH = Cylinder(diameter_m=4e-3)
# The chord of one of 256 sides is farther in than the circle by r (1 - cos(pi / 256)).
SAGITTA_M = PUNCH.radius_m * (1.0 - np.cos(np.pi / 256))


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a block whose surface is what is measured from."""
    return pad_model(brick_mesh((4, 4, 2)), order=ElementOrder.P1)


@pytest.fixture(scope="module")
def triangles() -> Indenter:
    """Return the punch as triangles."""
    return mesh_indenter(*cylinder_triangles(PUNCH), name="punch")


def _gaps(model: Model, indenter: Indenter, tip: FloatArray, rotation: FloatArray) -> FloatArray:
    state = model.rest_state(tip=tip, rotation=rotation)
    return model.surface.gaps(model.nodes, indenter, state)


@pytest.mark.parametrize("depth_m", [-0.5e-3, 0.3e-3])
@pytest.mark.parametrize("tilt_rad", [(0.0, 0.0), (0.1, -0.2)])
def test_triangles_are_as_far_as_the_formula(
    model: Model, triangles: Indenter, depth_m: float, tilt_rad: tuple[float, float]
) -> None:
    """Above the pad and in it, upright and tilted, to the facets' distance from the circle."""
    tip, rotation = np.array([0.2e-3, 0.1e-3, model.height_m - depth_m]), tilted(*tilt_rad)
    exact = _gaps(model, PUNCH, tip, rotation)
    found = _gaps(model, triangles, tip, rotation)
    assert np.abs(found - exact).max() <= 1.01 * SAGITTA_M


def test_a_gap_is_one_away_from_its_body(model: Model, triangles: Indenter) -> None:
    """No two points' gaps differ by more than the points are apart, and lifting adds the lift."""
    high = np.array([0.0, 0.0, model.height_m + 1e-3])
    low_gaps = _gaps(model, triangles, high, np.eye(3))
    lifted = _gaps(model, triangles, high + np.array([0.0, 0.0, 1e-3]), np.eye(3))
    assert np.all(lifted - low_gaps <= 1e-3 * (1.0 + 1e-9))
    under = np.isclose(low_gaps, 1e-3, rtol=1e-9)
    assert under.any()
    np.testing.assert_allclose(lifted[under], 2e-3, rtol=1e-9)
