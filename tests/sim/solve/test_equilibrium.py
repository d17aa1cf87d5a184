"""When Newton ends: enough, at a harmless standstill, or out of iterations."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Sphere
from sim.solve.descent_rules import note_residual, stagnates
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases.pads import pad_model, quarter_brick_mesh
from tacauchy_rig.core.errors import ConvergenceError


@wp.kernel(enable_backward=False, module="unique")
def _noted(
    history: wp.array(dtype=wp.float64),
    last: wp.array(dtype=wp.float64),
    still_out: wp.array(dtype=wp.bool),
):
    for k in range(history.shape[0]):
        note_residual(last, history[k])
        still_out[k] = stagnates(last, k + 1)


def _stand_still(residuals: list[float]) -> list[bool]:
    """Return after which residuals they stood still."""
    history = wp.array(residuals, dtype=wp.float64, device="cpu")
    last = wp.zeros(6, dtype=wp.float64, device="cpu")
    found = wp.zeros(len(residuals), dtype=wp.bool, device="cpu")
    wp.launch(_noted, 1, [history, last, found], device="cpu")
    return found.numpy().tolist()


@pytest.mark.parametrize("rate", [0.5, 0.8, 0.9, 0.95, 0.97])
def test_linear_convergence_is_no_standstill(rate: float) -> None:
    """A residual that shrinks steadily, however slowly, is left to."""
    assert not any(_stand_still([rate**k for k in range(100)]))


@pytest.mark.parametrize("noise", [[1.0], [1.0, 2.0], [1.2, 0.95, 3.0], [1.0, 1.1, 0.92, 1.4]])
def test_noise_is_a_standstill(noise: list[float]) -> None:
    """A residual that goes up and down about one value stands still, after some iterations."""
    assert any(_stand_still([1e6, 1e3, *(noise * 12)[:12]]))


def test_rounding_is_a_standstill_that_is_taken_and_told() -> None:
    """Asked for nothing at all, Newton ends in rounding, stalled, with the force of any press."""
    model = pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)
    forces, stalled = [], []
    for options in (SolverOptions(), SolverOptions(residual_relative=0.0, residual_floor_n=0.0)):
        path = LoadingPath(model, Sphere(diameter_m=6e-3), options=options)
        point = path.advance(0.2e-3)
        forces.append(point.force_n[2])
        stalled.append(point.equilibrium.stalled)
        assert point.equilibrium.residual_n <= 1e-8 * point.force_n[2]
    assert stalled == [False, True]
    assert forces[1] == pytest.approx(forces[0], rel=1e-8)


def test_what_would_do_harm_is_an_error_after_the_last_iteration() -> None:
    """Out of iterations far from equilibrium: the message has their number and the residual."""
    model = pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)
    path = LoadingPath(model, Sphere(diameter_m=6e-3))
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - 0.5e-3]))
    with pytest.raises(ConvergenceError, match=r"after 2 steps: residual .* N at a"):
        path.solver.settle(state, options=SolverOptions(iteration_max=2))
