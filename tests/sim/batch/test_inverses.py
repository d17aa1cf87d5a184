"""What a GPU multiplies with is what a processor solves; its layout is checked on the host."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
import warp as wp

from sim.batch import inverses
from sim.batch.environment import Trajectory
from sim.batch.inverses import (
    DenseProduct,
    FactoredInverses,
    dense_inverse,
    packed,
    padded_rows,
    tiling,
)
from sim.batch.pilot import Pilot, batch_model
from sim.device import Device
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Scene, Target
from tacauchy_rig.core.errors import ConfigError

_SCENE = Scene(
    pad=DiscPad(radius_m=7e-3, height_m=3.5e-3),
    material=Material(young_pa=0.3e6, poisson=0.45),
    indenter=Sphere(diameter_m=6e-3),
    target=Target(depth_m=0.2e-3),
)


@pytest.mark.parametrize(
    "trajectory",
    [Trajectory(depths_m=np.array([1e-4, 2e-4])), Trajectory(loads_n=np.array([0.05, 0.1]))],
    ids=["held", "pushed"],
)
def test_factors_and_inverses_are_one(trajectory: Trajectory) -> None:
    """Both undo the pilot's stiffness, with the indenter's height where that is an unknown."""
    model = batch_model(_SCENE, refinement=0.5)
    pilot = Pilot(model, _SCENE.indenter, trajectory, count=2)
    factored, pattern = FactoredInverses(pilot, count=2), model.pattern
    count = pattern.dof_count
    rng = np.random.default_rng(3)
    for which, stiffness in enumerate(pilot.states):
        upper = pattern.upper(stiffness.data)
        whole = np.zeros((count + 1,) * 2)
        whole[:count, :count] = (upper + scipy.sparse.triu(upper, 1).T).toarray()
        if pilot.is_pushed:
            whole[:count, count] = whole[count, :count] = stiffness.border
            whole[count, count] = stiffness.corner
        wanted = rng.standard_normal((2, count + 1))
        if not pilot.is_pushed:
            wanted[:, count] = 0.0
        sources = wanted @ whole
        found = wp.zeros(sources.shape, dtype=wp.float64, device="cpu")
        factored.which.fill_(which)
        factored.apply(np.array([0, 1]), wp.array(sources, dtype=wp.float64, device="cpu"), found)
        dense = dense_inverse(stiffness, pattern, pushed=pilot.is_pushed)
        for answer in (found.numpy(), sources @ dense):
            assert np.abs(answer - wanted).max() <= 2e-3 * np.abs(wanted).max()


@pytest.mark.parametrize("limit", ["unknowns", "memory"])
def test_what_does_not_fit_on_a_gpu_is_refused(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Too many unknowns, or too little memory: with both numbers, before anything is made."""

    class FullGpu(Device):
        is_gpu = True

    if limit == "unknowns":
        monkeypatch.setattr(inverses, "_UNKNOWNS_MAX", 100)
    else:
        monkeypatch.setattr(type(wp.get_device("cpu")), "free_memory", 1_000)
    model = batch_model(_SCENE, refinement=0.5)
    trajectory = Trajectory(depths_m=np.array([1e-4]))
    pilot = Pilot(model, _SCENE.indenter, trajectory, count=1)
    with pytest.raises(ConfigError, match=f"{model.pattern.dof_count} unknowns") as refused:
        inverses.inverses_for(pilot, FullGpu("cpu"), count=1)
    assert "GB" in refused.value.message
    assert pilot.dense is None


def test_a_lane_finds_its_entries() -> None:
    """Lane 4 g + m takes rows g and g + 8, and of the columns those it takes of a vector."""
    rng = np.random.default_rng(0)
    matrix = rng.integers(-500, 500, (288, 288)).astype(np.float16)
    found = packed(matrix)
    for tile, step, half, group, member in rng.integers([18, 9, 2, 8, 4], size=(50, 5)):
        row, column = 16 * tile + group, 32 * step + 8 * member + 4 * half
        wanted = [
            matrix[row + upper, column + low + odd]
            for low in (0, 2)
            for upper in (0, 8)
            for odd in (0, 1)
        ]
        assert found[tile, step, half, 4 * group + member].tolist() == wanted


@pytest.mark.parametrize("count", [1, 8, 9, 60, 64, 65, 256, 257, 1024])
def test_paddings_are_what_blocks_divide(count: int) -> None:
    """Rows hold a whole number of blocks, and no fewer than asked."""
    chosen = tiling(count)
    assert 1000 <= padded_rows(1000) < 1000 + 288
    assert padded_rows(1000) % chosen.rows == 0
    assert padded_rows(1000) % 32 == 0


@pytest.mark.gpu
@pytest.mark.parametrize("columns", [1, 8, 32, 64, 256, 320])
def test_product(columns: int) -> None:
    """A block is NumPy's product to float16; one without a matrix rests."""
    rng = np.random.default_rng(2)
    matrices = 1e5 * rng.standard_normal((2, 300, 300)).astype(np.float32)
    matrices += np.swapaxes(matrices, 1, 2)
    on = Device("cuda:0")
    product = DenseProduct([*matrices], count=columns, device=on)
    serving = np.arange(len(product.blocks)) % 3 - 1
    product.blocks.assign(serving.astype(np.int32))
    right = np.zeros((product.column_count, product.row_count), dtype=np.float16)
    right[:, :300] = rng.standard_normal((len(right), 300))
    scale = np.abs(right[:, :300].astype(np.float64) @ matrices[1]).max()
    out = on.zeros(right.shape, wp.float32)
    product.apply(None, on.array(right, wp.float16), out)
    for block, matrix in enumerate(serving):
        within = slice(block * product.width, (block + 1) * product.width)
        wanted = right[within, :300].astype(np.float64) @ matrices[matrix]
        wanted *= matrix >= 0
        error = np.abs(product.unit * out.numpy()[within, :300] - wanted).max()
        assert error <= 2e-3 * scale


@pytest.mark.gpu
def test_more_entries_than_an_array_s_dimension_holds() -> None:
    """Nineteen matrices of 11,000 rows, all the same but for the last, which is multiplied with."""
    rng = np.random.default_rng(5)
    one, last = (rng.standard_normal((11_000, 11_000), dtype=np.float32) for _ in range(2))
    on = Device("cuda:0")
    product = DenseProduct([*[one] * 18, last], count=1, device=on)
    product.blocks.fill_(18)
    right = np.zeros((product.column_count, product.row_count), dtype=np.float16)
    right[0, :11_000] = rng.standard_normal(11_000)
    out = on.zeros(right.shape, wp.float32)
    product.apply(None, on.array(right, wp.float16), out)
    wanted = last @ right[0, :11_000].astype(np.float32)
    error = np.abs(product.unit * out.numpy()[0, :11_000] - wanted).max()
    assert error <= 2e-3 * np.abs(wanted).max()
