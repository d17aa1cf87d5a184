"""The undeformed inverse and its correction, against dense matrices."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from sim.batch.contact_inverse import ContactInverse
from sim.batch.dense_inverse_kernels import pack
from sim.batch.rest_inverse import DenseRest, inverted
from sim.batch.sensor_model import sensor_model
from sim.contact.indenter_distance import Body, Poses, body_of, nearby_gap, posed, poses_at
from sim.device import Device
from sim.scene.indenter import Cylinder, Indenter, IndenterSet, Sphere, tilted
from sim.solve.descent_state import Act
from sim.solve.descents import Descents
from tacauchy_rig.core.errors import ConfigError
from tests.sim.batch.test_batch import BLOCK, GEL, PAD

CPU = Device("cpu")


def test_sweeping_inverts() -> None:
    """A positive definite matrix of three blocks, in its own place."""
    rng = np.random.default_rng(1)
    square = rng.normal(size=(192, 192))
    matrix = square @ square.T + 10.0 * np.eye(192)
    found = inverted(CPU.array(matrix, wp.float32), CPU).numpy()
    assert np.abs(found @ matrix - np.eye(192)).max() < 1e-5


def test_a_lane_finds_its_entries() -> None:
    """Lane 4 g + m takes rows g and g + 8 in their order, and the columns it takes of a vector."""
    rng = np.random.default_rng(0)
    matrix = rng.integers(-500, 500, (288, 288)).astype(np.float32)
    out = CPU.zeros((1, 288**2), wp.float16)
    order = rng.permutation(288)
    given = [CPU.array(matrix, wp.float32), 288, 9, 1.0, CPU.array(np.ones(288), wp.float32)]
    CPU.launch(pack, (18, 9, 512), [*given, CPU.array(order, wp.int32)], [out])
    found = out.numpy().reshape(18, 9, 2, 32, 8)
    for tile, step, half, group, member in rng.integers([18, 9, 2, 8, 4], size=(50, 5)):
        row, column = 16 * tile + group, 32 * step + 8 * member + 4 * half
        wanted = [
            matrix[order[row + upper], column + low + odd]
            for low in (0, 2)
            for upper in (0, 8)
            for odd in (0, 1)
        ]
        assert found[tile, step, half, 4 * group + member].tolist() == wanted


def test_an_inverse_that_does_not_fit_on_a_gpu_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both sizes are named before anything is made."""
    monkeypatch.setattr(type(wp.get_device("cpu")), "free_memory", 1_000)
    model = sensor_model(PAD, GEL, edge_m=4e-3)
    with pytest.raises(ConfigError, match=f"{model.pattern.dof_count} unknowns.* GB"):
        DenseRest(model, np.zeros((1, 3), dtype=np.int32), count=1)


@pytest.mark.gpu
@pytest.mark.parametrize("count", [1, 8, 60, 320])
def test_product(count: int) -> None:
    """It is as exact as the inverse's rounding to float16; a block without a matrix rests.

    Asked at the surface alone, it finds the same there.
    """
    model = sensor_model(PAD, GEL, edge_m=3e-3, device="cuda:0")
    size = model.pattern.dof_count
    upper = model.pattern.upper(model.rest_hessian_data()).toarray()
    whole = upper + np.triu(upper, 1).T
    surface = np.array([[5, 2, size - 1]], dtype=np.int32)
    inverse = DenseRest(model, surface, count=count)
    wanted = np.random.default_rng(2).standard_normal((inverse.column_count, size))
    asked = wanted @ whole
    scale = np.abs(asked).max()
    sources = np.zeros((inverse.column_count, inverse.row_count), dtype=np.float16)
    weights = inverse.weights.numpy()[:size]
    sources[:, :size] = asked / scale * weights
    on = Device("cuda:0")
    out = on.zeros(sources.shape, wp.float32)
    is_few = count <= 8
    blocks = np.arange(len(inverse.blocks), dtype=np.int32) % -2
    inverse.few.fill_(0 if is_few else -1)
    inverse.blocks.assign(np.full_like(blocks, -1) if is_few else blocks)
    given_now = on.array(sources, wp.float16)
    inverse.apply(None, given_now, out)
    there = on.zeros(sources.shape, wp.float32)
    inverse.apply(None, given_now, there, at_surface=True)
    assert np.array_equal(there.numpy()[:, surface[0]], out.numpy()[:, surface[0]])
    found = inverse.unit * scale * out.numpy()[:, :size].astype(np.float64) * weights
    solved, given = np.linalg.inv(whole), sources[:, :size].astype(np.float64)
    halves = (solved / inverse.unit / np.outer(weights, weights)).astype(np.float16)
    exact = given / weights * scale @ solved
    rounding = np.abs(inverse.unit * scale * (given @ halves) * weights - exact).max()
    rests = np.repeat(blocks, len(found) // len(blocks)) < 0
    if is_few:
        rests = np.arange(len(found)) >= 8
    assert np.abs(found[rests]).max(initial=0.0) == 0.0
    assert np.abs((found - exact)[~rests]).max() <= 1.5 * rounding


@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_corrected_inverse_is_that_of_gel_and_contact(friction: float, pushed: bool) -> None:
    """But for what is spared along a node's plane, and the weak spring of a pushed indenter.

    The error is measured in energy, where the undeformed inverse alone is far more off.
    """
    model = sensor_model(PAD, GEL, edge_m=3e-3, friction=friction)
    ball = Sphere(diameter_m=6e-3)
    inverse = ContactInverse(model, count=1, young_share=np.ones(1))
    descents = Descents(
        model, IndenterSet(bodies=(ball,), which=(0,)), inverse, count=1, keeps=True
    )
    inverse.serve(descents)
    state = model.rest_state(tip=np.array([0.5e-3, 0.0, PAD.height_m - 0.05e-3]))
    state.extension = model.contact_options.extension
    model.surface.refresh_grip(ball, state)
    descents.place(state, grip_start=state.grip)
    descents.set(act=Act.SOLVE, since=0, pushed=int(pushed))
    size = model.pattern.dof_count
    asked = np.zeros((1, size + 1))
    asked[0, :size] = np.random.default_rng(3).normal(size=size)
    asked[0, size] = 0.5 if pushed else 0.0
    descents.sources.assign(asked)
    inverse.apply(np.array([0], dtype=np.int32), descents.sources, descents.found)
    contact = model.surface.forces(state.positions, ball, state)
    upper = model.pattern.upper(
        model.hessian_data(model.nodes, contact.stiffness, projected=False)
    ).toarray()
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = upper + np.triu(upper, 1).T
    border = model.pattern.unknowns(model.surface.scatter(-contact.stiffness[..., 2]))
    whole[size, :size] = whole[:size, size] = border
    whole[size, size] = contact.stiffness[..., 2, 2].sum() if pushed else 1.0
    if not pushed:
        whole[size, :size] = whole[:size, size] = 0.0
    gel = model.pattern.upper(model.rest_hessian_data()).toarray()
    alone = np.append(np.linalg.solve(gel + np.triu(gel, 1).T, asked[0, :size]), 0.0)
    right = np.linalg.solve(whole, asked[0])
    corrected, without = (
        np.sqrt(off @ whole @ off) for off in (descents.found.numpy()[0] - right, alone - right)
    )
    assert corrected < 0.2 * np.sqrt(right @ whole @ right)
    assert corrected < 0.2 * without


@wp.kernel(enable_backward=False)
def _gaps_at(
    bodies: wp.array(dtype=Body),
    poses: Poses,
    places: wp.array(dtype=wp.vec3d),
    gap_out: wp.array2d(dtype=wp.float64),
):
    b, i = wp.tid()
    gap, _n = nearby_gap(posed(bodies, poses, b), places[i], wp.float64(0.0))
    gap_out[b, i] = gap


def _gaps(bodies: tuple[Indenter, ...], places: Any, rounding_m: float) -> Any:
    count = len(bodies)
    together = IndenterSet(bodies=bodies, which=tuple(range(count)), rounding_m=rounding_m)
    turns = np.tile(tilted(0.1, 0.2), (count, 1, 1))
    poses = poses_at(np.zeros((count, 3)), turns, CPU)
    out = CPU.zeros((count, len(places)), wp.float64)
    inputs = [body_of(together), poses, CPU.array(places, wp.vec3d)]
    CPU.launch(_gaps_at, out.shape, inputs, [out])
    return out.numpy()


def test_bodies_of_any_kind_lie_beside_one_another() -> None:
    """Each has the gaps that it has alone, two of triangles among them."""
    bodies = (Sphere(diameter_m=4e-3), BLOCK, Cylinder(diameter_m=3e-3), BLOCK)
    places = np.random.default_rng(4).uniform(-2e-3, 2e-3, (500, 3))
    together = _gaps(bodies, places, 0.0)
    for k, body in enumerate(bodies):
        np.testing.assert_allclose(together[k], _gaps((body,), places, 0.0)[0], atol=1e-15)


def test_a_rounded_body_is_a_distance() -> None:
    """No step of the place changes a gap by more than itself, where the gel may be."""
    rng = np.random.default_rng(5)
    places = rng.uniform([-2e-3, -2e-3, -0.5e-3], [2e-3, 2e-3, 1e-3], (20_000, 3))
    way = rng.normal(size=places.shape)
    way *= 1e-6 / np.linalg.norm(way, axis=1, keepdims=True)
    here, there = (_gaps((BLOCK,), at, 0.2e-3)[0] for at in (places, places + way))
    near = here < 0.1e-3
    assert near.sum() > 1000
    assert np.abs(there - here)[near].max() <= 1e-6 * 1.0001
