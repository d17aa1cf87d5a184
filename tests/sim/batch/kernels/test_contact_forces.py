"""Contact of a batch against that of one press, and its change against differences."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.arrays import FloatArray
from sim.batch.kernels.contact_forces import (
    BatchSurface,
    ContactPoints,
    batch_surface,
    contact_force,
    contact_points,
    contact_rate,
    spread_contact,
    touchable,
)
from sim.device import Device
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.tilted_indenter import tilted
from sim.solve.model import Model
from sim.studies.hard_cases.pads import HEIGHT_M
from tests.sim.batch.kernels.small_pad import block, moved_at_random, rows_of

INDENTERS: list[Indenter] = [
    Plane(),
    Sphere(diameter_m=40e-3),
    Cylinder(diameter_m=10e-3, fillet_m=2e-3),
]
TIP = np.array([0.2e-3, -0.1e-3, HEIGHT_M + 0.1e-3])
TURN = tilted(0.01, -0.02)
EXTENSION = 0.5
# Tip's rise and unknowns' motion along which changes are taken [m].
RISE_M, STEP_M = 1e-9, 1e-9


@wp.kernel(enable_backward=False)
def touch(
    surface: BatchSurface,
    tip: wp.vec3d,
    rise: wp.float32,
    displacements: wp.array(dtype=wp.float64),
    directions: wp.array(dtype=wp.float32),
    contact: ContactPoints,
    rates_out: wp.array(dtype=wp.vec3d),
):
    """Find force and change at every point; launches over [point_count]."""
    i = wp.tid()
    v, stiffness, _gap = contact_force(i, 0, tip, surface, displacements)
    contact.forces[0, i] = v
    rates_out[i] = contact_rate(i, rise, stiffness, surface, directions)


@wp.kernel(enable_backward=False)
def spread(surface: BatchSurface, contact: ContactPoints):
    """Share points' forces among nodes; launches over [face_node_count * face_count]."""
    spread_contact(wp.tid(), 0, surface, contact)


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a small block."""
    return block()


class Touched:
    """What one environment's indenter feels at some displacements, all faces kept.

    Attributes:
        forces: Of the points [N], shape [face_count, point_count, 3].
        rates: Their change along the direction [N], the same shape.
        nodal: What they come to at the nodes [N], shape [node_count, 3].
    """

    def __init__(
        self, model: Model, indenter: Indenter, moved: FloatArray, along: FloatArray, rise_m: float
    ) -> None:
        device, pad = Device("cpu"), model.discretisation
        numbered, values = rows_of(model, moved)
        _, directions = rows_of(model, along)
        surface = batch_surface(
            pad,
            numbered,
            indenter,
            rotations=TURN[None],
            young_pa=[model.young_pa],
            kept=np.ones(len(pad.faces), dtype=np.bool_),
            contact=model.contact_options,
            extension=EXTENSION,
            device=device,
        )
        contact, count = contact_points(1, surface, device), surface.areas.size
        rates = device.zeros(count, wp.vec3d)
        inputs = [surface, wp.vec3d(*TIP), rise_m, device.array(values, wp.float64)]
        inputs.append(device.array(directions, wp.float32))
        device.launch(touch, (count,), inputs, [contact, rates])
        device.launch(spread, (surface.rest.size,), [surface], [contact])
        shape = (*surface.areas.shape, 3)
        self.forces = contact.forces.numpy().reshape(shape).swapaxes(0, 1)
        self.rates = rates.numpy().reshape(shape).swapaxes(0, 1)
        self.nodal = np.zeros_like(model.nodes)
        shared = contact.face_forces.numpy().reshape(-1, 3, len(pad.faces)).transpose(2, 0, 1)
        np.add.at(self.nodal, pad.faces, shared)


def of_a_press(model: Model, indenter: Indenter, moved: FloatArray, tip: FloatArray) -> FloatArray:
    """Return the forces that ``ContactSurface`` finds [N], shape [face_count, point_count, 3]."""
    state = model.rest_state(tip=tip, rotation=TURN)
    state.extension = EXTENSION
    return model.surface.forces(model.nodes + moved, indenter, state).forces


@pytest.mark.parametrize("indenter", INDENTERS)
def test_contact_is_that_of_a_press(model: Model, indenter: Indenter) -> None:
    """Forces point by point, their sums at the nodes, and their change as things move."""
    moved, along = moved_at_random(model, 1e-5, seed=1), moved_at_random(model, STEP_M, seed=2)
    found = Touched(model, indenter, moved, along, RISE_M)
    wanted = of_a_press(model, indenter, moved, TIP)
    size = np.abs(wanted).max()
    assert size > 0.0
    np.testing.assert_allclose(found.forces, wanted, atol=1e-11 * size)
    np.testing.assert_allclose(found.nodal, model.surface.scatter(wanted), atol=1e-11 * size)
    up = np.array([0.0, 0.0, RISE_M])
    ahead, behind = (
        of_a_press(model, indenter, moved + sign * along, TIP + sign * up) for sign in (1.0, -1.0)
    )
    change = 0.5 * (ahead - behind)
    assert np.linalg.norm(found.rates - change) < 1e-3 * np.linalg.norm(change)


@pytest.mark.parametrize(
    "indenter", [Plane(), Sphere(diameter_m=4e-3), Cylinder(diameter_m=2e-3, fillet_m=0.4e-3)]
)
def test_faces_that_are_left_out_feel_nothing(model: Model, indenter: Indenter) -> None:
    """Of an upright body a millimetre deep in the block, at either of two places."""
    places = np.array([[0.0, 0.0], [1e-3, -2e-3]])
    kept = touchable(model.discretisation, indenter, places)
    for x, y in places:
        state = model.rest_state(tip=np.array([x, y, HEIGHT_M - 1e-3]))
        forces = model.surface.forces(model.nodes, indenter, state).forces
        assert forces[kept].any()
        assert not forces[~kept].any()
    assert kept.all() == isinstance(indenter, Plane)
