"""What a pad's contact points sum up to: areas, pressure, forces, moments."""

from __future__ import annotations

import numpy as np
import pytest

from sim.contact.contact_surface import ContactForces, ContactOptions, contact_rounding_n
from sim.device import KERNEL_EPSILON
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Plane, Sphere
from sim.solve.model import Model
from sim.studies.hard_cases.pads import HEIGHT_M, YOUNG_PA, brick_mesh, pad_model

BARRIER_M = 2e-6
SIZE_M = 12e-3


@pytest.fixture(scope="module", params=list(ElementOrder))
def model(request: pytest.FixtureRequest) -> Model:
    """Return a block clamped at its base."""
    options = ContactOptions(distance_m=BARRIER_M)
    return pad_model(brick_mesh((3, 3, 2)), order=request.param, contact_options=options)


def pressed(model: Model, gap_m: float) -> ContactForces:
    """Return the contact of a plate over the undeformed block."""
    state = model.rest_state(tip=np.array([0.0, 0.0, HEIGHT_M + gap_m]))
    return model.surface.forces(model.nodes, Plane(), state)


def test_points_share_out_the_free_surface(model: Model) -> None:
    """Top and sides, not the clamped base; at rest the area vectors have the same sizes."""
    areas = model.surface.areas
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(SIZE_M**2 + 4.0 * SIZE_M * HEIGHT_M, rel=1e-12)
    vectors = model.surface.area_vectors(model.nodes)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=2), areas, rtol=1e-9)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.35])
def test_a_plate_feels_the_barriers_pressure_on_the_top(model: Model, share: float) -> None:
    """Pressure kappa / d_hat (1/s - 1) with kappa 8 E d_hat, at a gap of s d_hat."""
    found = pressed(model, share * BARRIER_M).forces.sum(axis=(0, 1))
    wanted = 8.0 * YOUNG_PA * (1.0 / share - 1.0) * SIZE_M**2
    # The gap is the difference of heights a thousand times larger.
    np.testing.assert_allclose(found, [0.0, 0.0, wanted], rtol=1e-9, atol=1e-9 * wanted)


def test_nodes_take_over_force_and_moment_of_the_points(model: Model) -> None:
    """Sharing point forces among nodes changes neither, on a deformed and tilted surface."""
    rng = np.random.default_rng(1)
    moved = model.nodes + rng.normal(scale=1e-7, size=model.nodes.shape)
    state = model.rest_state(tip=np.array([1e-3, -2e-3, HEIGHT_M + 0.5 * BARRIER_M]))
    found = model.surface.forces(moved, Sphere(diameter_m=1.0), state)
    nodal = model.surface.scatter(found.forces)
    size = np.abs(found.forces).sum()
    assert size > 0.0
    np.testing.assert_allclose(nodal.sum(axis=0), found.forces.sum(axis=(0, 1)), atol=1e-12 * size)
    wanted = np.cross(found.points, found.forces).sum(axis=(0, 1))
    np.testing.assert_allclose(
        np.cross(moved, nodal).sum(axis=0), wanted, atol=1e-12 * size * SIZE_M
    )


def test_rounding_is_what_rounded_points_would_change(model: Model) -> None:
    """All points off by one rounding of their coordinates: no more than what is stated."""
    here = pressed(model, 0.5 * BARRIER_M)
    raised = model.rest_state(tip=np.array([0.0, 0.0, HEIGHT_M * (1.0 + 1e-8) + 0.5 * BARRIER_M]))
    there = model.surface.forces(model.nodes, Plane(), raised)
    change = float(np.linalg.norm(there.forces - here.forces)) * KERNEL_EPSILON / 1e-8
    assert 0.5 * change <= contact_rounding_n(here) <= 3.0 * change
