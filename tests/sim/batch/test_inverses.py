"""What a GPU multiplies with is what a processor solves."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
import warp as wp

from sim.batch.environment import Course
from sim.batch.inverses import FactoredInverses, dense_inverse
from sim.batch.pilot import Pilot, batch_model
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Scene, Target

_SCENE = Scene(
    pad=DiscPad(radius_m=7e-3, height_m=3.5e-3),
    material=Material(young_pa=0.3e6, poisson=0.45),
    indenter=Sphere(diameter_m=6e-3),
    target=Target(depth_m=0.2e-3),
)


@pytest.mark.parametrize(
    "course",
    [Course(depths_m=np.array([1e-4, 2e-4])), Course(loads_n=np.array([0.05, 0.1]))],
    ids=["held", "pushed"],
)
def test_factors_and_inverses_are_one(course: Course) -> None:
    """Both undo the pilot's stiffness, with the indenter's height where that is an unknown."""
    model = batch_model(_SCENE, refinement=0.5)
    pilot = Pilot(model, _SCENE.indenter, course, count=2)
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
