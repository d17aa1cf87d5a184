"""Cases 2 and 15: starts that no press would begin with."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases.pads import pad_model, quarter_brick_mesh
from sim.studies.hard_cases.starts import ENERGY_ROUNDING, random_start
from tacauchy_rig.core.errors import ConvergenceError


def test_random_starts_end_stationary() -> None:
    """Case 2: the energy never rises, and where it ends is said."""
    outcome = random_start()
    assert outcome.passed
    measured = outcome.measured
    assert float(measured["energy_rise_max_over_first"]) <= ENERGY_ROUNDING
    at_rest = [int(measured[f"ended_at_rest_{order.value}"]) for order in ElementOrder]
    knotted = int(measured["ended_knotted_but_stationary"])
    assert sum(at_rest) + knotted == measured["starts"]
    # A knot is told by its corners, since det F does not show it.
    assert (int(measured["elements_whose_corners_are_inside_out_max"]) > 0) == (knotted > 0)
    assert np.isfinite(float(measured["det_F_min_at_the_end"]))


@pytest.mark.parametrize(
    ("indenter", "depth_m", "told"),
    [
        (Sphere(diameter_m=6e-3), 1.3e-3, "starts 1.29 mm inside the indenter"),
        (Sphere(diameter_m=6e-3), 5e-3, "nearest side does not face the gel"),
        (Cylinder(diameter_m=1e-3, fillet_m=1e-4), 1e-3, "nearest side does not face the gel"),
    ],
)
def test_deep_starts_are_refused_unchanged(indenter: Indenter, depth_m: float, told: str) -> None:
    """Case 15: too deep, through its far side, or past its flank; the state is left as it was."""
    model = pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)
    path = LoadingPath(model, indenter)
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - depth_m]))
    with pytest.raises(ConvergenceError, match=told):
        path.solver.settle(state, options=SolverOptions())
    assert np.array_equal(state.positions, model.nodes)


def test_a_shallow_start_inside_is_resolved() -> None:
    """Case 15: begun 0.5 mm inside the gel, the force is that of a press."""
    model = pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)
    indenter = Sphere(diameter_m=6e-3)
    path = LoadingPath(model, indenter)
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - 0.5e-3]))
    found = path.solver.settle(state, options=SolverOptions())
    force = model.mesh.symmetry.whole_force(found.contact.forces.sum(axis=(0, 1)))[2]
    assert force == pytest.approx(path.advance(0.5e-3).force_n[2], rel=1e-6)
    assert model.surface.gaps(state.positions, indenter, state).min() > 0.0
