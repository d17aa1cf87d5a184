"""Barrier contact against analytic indenters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.contact.contact_surface import ContactOptions, State
from sim.mesh.tet_mesh import MirrorSymmetry
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.material import LawName
from sim.solve.model import Model
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
@pytest.mark.parametrize("indenter", INDENTERS[:3])
def test_stiffness_is_the_derivative_of_the_forces(indenter: Indenter, friction: float) -> None:
    """The exact stiffness includes the indenter's curvature, and friction's."""
    model = contact_model(friction=friction)
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
def test_stiffness_without_curvature_is_semidefinite(indenter: Indenter) -> None:
    """What Newton falls back to has no negative eigenvalue."""
    model = contact_model(friction=0.5)
    state = touching(model, indenter)
    stiffness = model.surface.forces(state.positions, indenter, state, curved=False).stiffness
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
