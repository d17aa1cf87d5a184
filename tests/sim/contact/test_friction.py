"""Coulomb's law at single contact points: direction, size, memory."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from sim.contact.surface_and_grip import ContactOptions, State
from sim.device import Device
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Indenter, Plane, Sphere
from sim.solve.model import Model
from sim.studies.hard_cases.small_pads import brick_mesh, pad_model
from tacauchy_rig.core.arrays import FloatArray

MU, SLIP_M, BARRIER_M = 0.6, 1e-6, 2e-6
WAY = np.array([0.6, 0.8, 0.0])


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a block with friction on its top."""
    options = ContactOptions(distance_m=BARRIER_M, friction=MU, slip_m=SLIP_M)
    return pad_model(brick_mesh((3, 3, 1)), order=ElementOrder.P1, contact_options=options)


def gripped(model: Model, indenter: Indenter, *, gap_m: float = 0.5 * BARRIER_M) -> State:
    """Return an indenter that has just touched, and that nothing has dragged yet."""
    state = model.rest_state(tip=np.array([0.0, 0.0, model.height_m + gap_m]))
    model.surface.refresh_grip(indenter, state)
    return state


def rubbing(model: Model, indenter: Indenter, state: State, offset_m: FloatArray) -> FloatArray:
    """Return friction's force on the gel [N] once it is moved by an offset, shape [f, p, 3]."""
    moved = state.positions + offset_m
    without = state.copy()
    without.grip = None
    with_grip = model.surface.forces(moved, indenter, state).forces
    return np.asarray(model.surface.forces(moved, indenter, without).forces - with_grip)


def limits(model: Model, state: State) -> FloatArray:
    """Return mu N of every point [N], shape [f, p]."""
    assert state.grip is not None
    return np.asarray(MU * np.linalg.norm(state.grip.loads, axis=2) * model.surface.areas)


@pytest.mark.parametrize("slips", [0.25, 0.75, 1.0, 5.0])
def test_friction_is_against_the_slip_and_mu_times_the_load(model: Model, slips: float) -> None:
    """Two y - y^2 of mu N, y the offset in slip lengths, and mu N from y = 1 on."""
    state = gripped(model, Plane())
    share = 2.0 * slips - slips**2 if slips < 1.0 else 1.0
    found = rubbing(model, Plane(), state, slips * SLIP_M * WAY)
    wanted = -share * limits(model, state)[..., None] * WAY
    assert np.count_nonzero(limits(model, state)) > 10
    np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-12 * np.abs(wanted).max())


def test_friction_lies_in_the_surface_and_never_exceeds_mu_times_the_load(model: Model) -> None:
    """Under a ball whose normals all differ, for slips in any direction."""
    ball = Sphere(diameter_m=2.0)  # flat enough to touch all of the top within d_hat
    state = gripped(model, ball, gap_m=0.2 * BARRIER_M)
    assert state.grip is not None
    limit, rng = limits(model, state), np.random.default_rng(5)
    for offset in rng.normal(scale=SLIP_M, size=(10, 3)):
        found = rubbing(model, ball, state, offset)
        assert np.linalg.norm(found, axis=2).max() > 0.0
        assert np.all(np.linalg.norm(found, axis=2) <= limit * (1.0 + 1e-9))
        along_normal = np.einsum("fpi,fpi->fp", found, state.grip.loads)
        sizes = np.linalg.norm(found, axis=2) * np.linalg.norm(state.grip.loads, axis=2)
        assert np.all(np.abs(along_normal) <= 1e-7 * sizes.max())


def test_a_point_that_has_slid_is_held_where_it_is(model: Model) -> None:
    """Its anchor follows at the slip length: back by that is no force, by twice that mu N back."""
    state = gripped(model, Plane())
    state.positions = state.positions + 5.0 * SLIP_M * WAY
    model.surface.drag_anchors(Plane(), state)
    full = limits(model, state)[..., None] * WAY
    size = np.abs(full).max()
    for back, wanted in ((0.0, -full), (1.0, 0.0 * full), (2.0, full)):
        found = rubbing(model, Plane(), state, -back * SLIP_M * WAY)
        np.testing.assert_allclose(found, wanted, atol=1e-6 * size)


def test_a_point_that_sticks_does_not_creep(model: Model) -> None:
    """However often its state is taken over, the force on it stays."""
    state = gripped(model, Plane())
    state.positions = state.positions + 0.5 * SLIP_M * WAY
    first = rubbing(model, Plane(), state, np.zeros(3))
    for _ in range(3):
        model.surface.refresh_grip(Plane(), state)
        model.surface.drag_anchors(Plane(), state)
    assert np.abs(first).max() > 0.0
    np.testing.assert_allclose(
        rubbing(model, Plane(), state, np.zeros(3)), first, atol=1e-9 * np.abs(first).max()
    )


def test_a_point_that_left_is_let_go(model: Model) -> None:
    """Beyond d_hat nothing is held and nothing drags."""
    state = gripped(model, Plane())
    state.tip = state.tip + np.array([0.0, 0.0, BARRIER_M])
    model.surface.refresh_grip(Plane(), state)
    assert state.grip is not None
    assert not state.grip.held.any()
    assert not rubbing(model, Plane(), state, 3.0 * SLIP_M * WAY).any()


def test_half_of_a_change_is_taken_over_where_points_cycle(model: Model) -> None:
    """Pressure and share held lie halfway between what was lagged and what is there."""
    surface, indenter = model.surface, Plane()
    state = gripped(model, indenter)
    lagged = state.grip
    state.tip = state.tip - [0.0, 0.0, 0.3 * BARRIER_M]
    device = Device("cpu")
    pressed = surface.pressed(state.positions, indenter, state)
    inputs = [pressed, device.array([2], wp.int32), surface.grip_arrays(lagged)]
    room = [*surface.buffers(1)[:2], *(surface._points(wp.float64) for _ in range(2))]
    device.launch(surface.kernels.hold, (1, *surface.areas.shape), inputs, room)
    halved = surface.grip_of(pressed.grip)
    surface.refresh_grip(indenter, state)
    assert lagged is not None
    assert halved is not None
    assert state.grip is not None
    assert np.abs(state.grip.loads - lagged.loads).max() > 0.0
    assert np.allclose(halved.loads, 0.5 * (lagged.loads + state.grip.loads), rtol=1e-12)
    assert np.allclose(halved.held, 0.5 * (lagged.held + state.grip.held), rtol=1e-12)


def test_points_held_anew_leave_what_an_evaluation_would_find(model: Model) -> None:
    """Nodal forces and energies once a pressure is taken over, without evaluating all again."""
    surface, indenter = model.surface, Plane()
    state = gripped(model, indenter)
    start = surface.grip_arrays(state.grip)
    state.tip = state.tip - [0.0, 0.0, 0.3 * BARRIER_M]
    state.positions = state.positions + 0.4 * SLIP_M * WAY
    device, shape = Device("cpu"), (1, *surface.areas.shape)
    inputs = [surface.pressed(state.positions, indenter, state), device.array([1], wp.int32)]

    def touched() -> tuple[Any, ...]:
        room = surface.buffers(1)
        device.launch(surface.kernels.touch, shape, inputs, list(room))
        return room

    before = touched()
    forces, energies = (each.numpy().copy() for each in before[:2])
    changes = [surface._points(wp.float64) for _ in range(2)]
    device.launch(surface.kernels.hold, shape, [*inputs, start], [*before[:2], *changes])
    anew = touched()
    for was, corrected, wanted in zip((forces, energies), before, anew, strict=False):
        size = np.abs(wanted.numpy()).max()
        assert np.abs(wanted.numpy() - was).max() > 1e-2 * size
        np.testing.assert_allclose(corrected.numpy(), wanted.numpy(), atol=1e-12 * size)
