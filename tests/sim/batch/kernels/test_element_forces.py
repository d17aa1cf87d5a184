"""Forces of a batch's elements against those of one press, and their change against differences."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp

from sim.arrays import FloatArray
from sim.batch.kernels.element_forces import (
    TANGENT_SIZE,
    BatchGel,
    Tangents,
    batch_gel,
    forces_function,
    rates_function,
)
from sim.batch.kernels.state import zeroed
from sim.device import Device
from sim.material.laws.tangent import Law
from sim.mesh.elements import ElementOrder, reference_element
from sim.scene.material import LawName
from sim.solve.model import Model
from tests.sim.batch.kernels.small_pad import block, moved_at_random, rows_of

REFERENCE = reference_element(ElementOrder.P1)
NODES = REFERENCE.node_count


@cache
def kernel(law: Law) -> Any:
    """Build the kernel; it launches over [element_count]."""
    element_forces, element_rates = forces_function(law, REFERENCE), rates_function(REFERENCE)

    @wp.kernel(enable_backward=False, module="unique")
    def evaluate(
        gel: BatchGel,
        displacements: wp.array(dtype=wp.float64),
        directions: wp.array(dtype=wp.float32),
        tangents: Tangents,
        forces_out: wp.array3d(dtype=wp.float64),
        rates_out: wp.array3d(dtype=wp.float32),
    ):
        e = wp.tid()
        forces = element_forces(e, 0, gel, displacements, tangents)
        rates = element_rates(e, 0, gel, directions, tangents)
        for k in range(wp.static(NODES)):
            for axis in range(3):
                forces_out[e, k, axis] = forces[k, axis]
                rates_out[e, k, axis] = rates[k, axis]

    return evaluate


@pytest.fixture(scope="module", params=[LawName.STABLE_NEO_HOOKEAN, LawName.NEO_HOOKEAN])
def model(request: pytest.FixtureRequest) -> Model:
    """Return a small block; of a tangent's terms, one law lacks b and the other c."""
    return block(law_name=request.param)


def nodal(model: Model, moved: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return forces and their change along a direction, both over the unknowns [N]."""
    device, pad, count = Device("cpu"), model.discretisation, len(model.elements)
    numbered, values = rows_of(model, moved)
    _, directions = rows_of(model, along)
    materials = [(model.young_pa, model.poisson)]
    gel = batch_gel(pad, numbered, model.law, materials, device)
    shape = (count, NODES, 3)
    out = [device.zeros(shape, kind) for kind in (wp.float64, wp.float32)]
    inputs = [gel, device.array(values, wp.float64), device.array(directions, wp.float32)]
    tangents = zeroed(Tangents, (1, TANGENT_SIZE * gel.weights.size), device)
    device.launch(kernel(model.law), (count,), [*inputs, tangents], out)
    sums = np.zeros((2, *model.nodes.shape))
    for total, found in zip(sums, out, strict=True):
        np.add.at(total, pad.elements, found.numpy())
    return model.pattern.unknowns(sums[0]), model.pattern.unknowns(sums[1])


def test_forces_are_those_of_a_press(model: Model) -> None:
    """At the same displacements, to rounding."""
    moved = moved_at_random(model, 1e-4, seed=1)
    found, _ = nodal(model, moved, moved)
    wanted = model.pattern.unknowns(model.gel.gradient(model.nodes + moved))
    np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max())


def test_rates_are_the_change_of_the_forces(model: Model) -> None:
    """By central differences, to the float16 in which tangents are kept."""
    moved, along = moved_at_random(model, 1e-4, seed=1), moved_at_random(model, 1e-6, seed=2)
    _, rates = nodal(model, moved, along)
    ahead, behind = (nodal(model, moved + sign * along, along)[0] for sign in (1.0, -1.0))
    wanted = 0.5 * (ahead - behind)
    assert np.linalg.norm(rates - wanted) < 2e-3 * np.linalg.norm(wanted)


def test_rates_are_symmetric(model: Model) -> None:
    """An energy's second derivative is, and conjugate gradients need it, whatever was rounded."""
    moved = moved_at_random(model, 1e-4, seed=1)
    one, other = (moved_at_random(model, 1e-6, seed=seed) for seed in (2, 3))
    (_, by_one), (_, by_other) = (nodal(model, moved, along) for along in (one, other))
    there = float(by_one @ model.pattern.unknowns(other))
    back = float(by_other @ model.pattern.unknowns(one))
    size = np.linalg.norm(by_one) * np.linalg.norm(model.pattern.unknowns(other))
    assert there == pytest.approx(back, abs=1e-6 * size)
