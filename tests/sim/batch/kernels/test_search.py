"""Conjugate gradients of a batch keep what defines them, step after step."""

from __future__ import annotations

import numpy as np
import pytest

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, Environment
from sim.batch.iteration import Iteration
from sim.batch.kernels.state import SEARCH
from sim.batch.pilot import Pilot, batch_model
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Scene, Target

STEPS = 5
DEPTH_M = 0.2e-3
# Of the size of test_batch's, so that the same builds of the kernels serve both.
SCENE = Scene(
    pad=DiscPad(radius_m=7e-3, height_m=3.5e-3),
    material=Material(young_pa=0.3e6, poisson=0.47),
    indenter=Cylinder(diameter_m=4e-3, fillet_m=0.4e-3),
    target=Target(depth_m=DEPTH_M),
)


@pytest.fixture(scope="module")
def searching() -> Iteration:
    """Return a press in its first search, of a gel less like rubber than its pilot's.

    Its stiffness is then not the preconditioner's, and a search takes many steps. The ball is so
    flat that where it overlaps the gel at first its curvature takes away no stiffness.
    """
    pilot = Pilot(batch_model(SCENE, refinement=0.6), Sphere(diameter_m=0.2), DEPTH_M, count=1)
    environment = Environment(young_pa=0.6e6, poisson=0.3, depths_m=np.array([0.1 * DEPTH_M]))
    # So small a share of the first residual that the search is not over before it was looked at.
    batch = Batch(pilot, [environment], options=BatchOptions(forcing=1e-12))
    batch.iteration.reset()
    batch.iteration.begin(*batch._segments[0])
    batch.iteration.run()
    assert batch.iteration.progress.status.numpy()[0] == SEARCH
    return batch.iteration


def test_each_step_ends_at_the_least_energy_and_goes_a_conjugate_way(searching: Iteration) -> None:
    """What is left stands on the direction, K d on every other d, and the steps add up."""
    vectors, count = searching.vectors, searching._row_count
    directions, rates, residuals = [], [], []
    first = vectors.residuals.numpy()[0, :count].astype(np.float64)
    for _ in range(STEPS):
        directions.append(vectors.directions.numpy()[0, :count].astype(np.float64))
        searching._search()
        rates.append(vectors.rates.numpy()[0, :count].astype(np.float64))
        residuals.append(vectors.residuals.numpy()[0, :count].astype(np.float64))
        searching._precondition()
        searching._turn()
    steps = vectors.steps.numpy()[0, :count].astype(np.float64)
    curvatures = np.array([d @ k for d, k in zip(directions, rates, strict=True)])
    assert curvatures.min() > 0.0
    for k in range(STEPS):
        for j in range(k):
            size = np.sqrt(curvatures[j] * curvatures[k])
            assert abs(directions[k] @ rates[j]) < 1e-3 * size
        size = np.linalg.norm(residuals[k]) * np.linalg.norm(directions[k])
        assert abs(residuals[k] @ directions[k]) < 1e-4 * size
    # The steps add up to what took the residual from its first value to its last.
    lengths = np.linalg.lstsq(np.stack(directions, axis=1), steps, rcond=None)[0]
    left = first - np.stack(rates, axis=1) @ lengths
    np.testing.assert_allclose(left, residuals[-1], atol=1e-4 * np.abs(first).max())
    assert np.linalg.norm(residuals[-1]) < 0.1 * np.linalg.norm(first)
