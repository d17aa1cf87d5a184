"""Barrier contact against analytic indenters, and what a pad's contact points sum up to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.contact.surface_and_grip import ContactForces, ContactOptions, State
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.material import LawName
from sim.solve.model import Model
from sim.studies.hard_cases.small_pads import HEIGHT_M, YOUNG_PA, brick_mesh, pad_model
from tacauchy_rig.core.arrays import FloatArray
from tests.sim.material.small_disc import disc_model

HEIGHT = 2e-3
INDENTERS: list[Indenter] = [
    Plane(),
    Sphere(diameter_m=4e-3),
    Cylinder(diameter_m=2e-3, fillet_m=0.4e-3),
    Cylinder(diameter_m=2e-3),
]


def contact_model(*, bonded: bool = False, friction: float = 0.0) -> Model:
    """Return a pad whose barrier reaches far, so that many points are in it."""
    options = ContactOptions(distance_m=2e-4, bonded=bonded, friction=friction)
    return disc_model(
        LawName.LINEAR, size_m=0.4e-3, symmetry=MirrorSymmetry(), contact_options=options
    )


def touching(model: Model, indenter: Indenter) -> State:
    """Return a tilted indenter 50 um above a slightly rough pad, its points anchored."""
    angle = 0.05
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    state = model.rest_state(tip=np.array([1e-4, 0.0, HEIGHT + 2e-4]), rotation=turn)
    rng = np.random.default_rng(3)
    state.positions = state.positions + rng.normal(scale=2e-6, size=state.positions.shape)
    model.surface.refresh_grip(indenter, state)
    return state


@pytest.mark.parametrize(
    ("bonded", "friction"), [(False, 0.0), (True, 0.0), (False, 0.5)], ids=["free", "bonded", "mu"]
)
@pytest.mark.parametrize("indenter", INDENTERS)
def test_forces_are_derivatives_of_the_energy(
    indenter: Indenter, bonded: bool, friction: float
) -> None:
    """The nodal gradient is the energy's slope, for every shape, tilted, sticking and sliding."""
    model = contact_model(bonded=bonded, friction=friction)
    state = touching(model, indenter)
    rng = np.random.default_rng(4)
    motion = rng.normal(scale=1e-9, size=model.nodes.shape)
    moved = state.positions + 1e-6 * rng.normal(size=model.nodes.shape)
    forces = model.surface.forces(moved, indenter, state)
    rise = (
        model.surface.energy(moved + motion, indenter, state)
        - model.surface.energy(moved - motion, indenter, state)
    ) / 2.0
    assert np.abs(forces.forces).max() > 0.0
    assert rise == pytest.approx(np.sum(model.surface.scatter(forces.forces) * motion), rel=1e-4)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_stiffness_is_the_derivative_of_the_forces(friction: float) -> None:
    """Under a flat indenter it is exact, friction's included."""
    model, indenter = contact_model(friction=friction), Plane()
    state = touching(model, indenter)
    state.positions = state.positions + 5e-7
    rng = np.random.default_rng(6)
    motion = rng.normal(scale=1e-9, size=model.nodes.shape)
    ahead = model.surface.forces(state.positions + motion, indenter, state)
    behind = model.surface.forces(state.positions - motion, indenter, state)
    here = model.surface.forces(state.positions, indenter, state)
    change: FloatArray = (ahead.forces - behind.forces) / 2.0
    moved = (ahead.points - behind.points) / 2.0
    predicted = np.einsum("fpij,fpj->fpi", here.stiffness, moved)
    assert np.abs(predicted - change).max() < 1e-3 * np.abs(change).max()


@pytest.mark.parametrize("indenter", INDENTERS)
def test_stiffness_is_semidefinite(indenter: Indenter) -> None:
    """Without the indenter's curvature it has no negative eigenvalue."""
    model = contact_model(friction=0.5)
    state = touching(model, indenter)
    stiffness = model.surface.forces(state.positions, indenter, state).stiffness
    assert np.linalg.eigvalsh(stiffness).min() >= -1e-9 * np.abs(stiffness).max()


def test_no_contact_means_exactly_no_force() -> None:
    """Beyond d_hat nothing is felt."""
    model = contact_model()
    state = model.rest_state(tip=np.array([0.0, 0.0, HEIGHT + 2.01e-4]))
    forces = model.surface.forces(model.nodes, Plane(), state)
    assert not forces.forces.any()
    assert model.surface.energy(model.nodes, Plane(), state) == 0.0


def test_barrier_joins_its_parabola_smoothly() -> None:
    """Energy and force do not jump where the extension begins."""
    model = contact_model()
    state = model.rest_state(tip=np.zeros(3))
    state.extension = 0.3
    near = []
    for gap in (0.3 - 1e-7, 0.3 + 1e-7):
        at = replace_tip(state, HEIGHT + gap * 2e-4)
        force = model.surface.forces(model.nodes, Plane(), at).forces.sum(axis=(0, 1))[2]
        near.append((model.surface.energy(model.nodes, Plane(), at), force))
    assert near[0] == pytest.approx(near[1], rel=1e-5)


def replace_tip(state: State, height_m: float) -> State:
    """Return the state with the tip at another height."""
    return replace(state, tip=np.array([0.0, 0.0, height_m]))


@pytest.mark.parametrize("indenter", INDENTERS)
def test_gap_is_the_distance_to_the_lower_surface(indenter: Indenter) -> None:
    """The device's distance agrees with a brute search over the body's profile."""
    model = contact_model()
    state = model.rest_state(tip=np.array([0.0, 0.0, HEIGHT + 1e-4]))
    points = model.surface.forces(model.nodes, indenter, state).points.reshape(-1, 3)
    radius = np.linspace(0.0, 6e-3, 12001)
    height = indenter.lower_surface(radius, np.zeros_like(radius))
    radius, height = radius[np.isfinite(height)], height[np.isfinite(height)]
    sideways = np.hypot(points[:, 0], points[:, 1])[:, None] - radius
    below = (state.tip[2] + height) - points[:, 2][:, None]
    nearest = np.hypot(sideways, below).min(axis=1)
    gaps = model.surface.gaps(model.nodes, indenter, state).reshape(-1)
    assert gaps == pytest.approx(nearest, abs=1e-6)


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
