"""Starts that overlap, or are inside out."""

import numpy as np
import pytest

from sim.contact.surface_and_grip import State
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Sphere
from sim.solve.equilibrium import EquilibriumSolver, SolverOptions
from sim.solve.loading_path import touch_height
from sim.solve.model import Model
from sim.solve.refused_overlap import OVERLAP_SHARE, overlap_fraction, refuse_deep_overlap
from sim.studies.hard_cases.small_pads import brick_mesh, pad_model
from tacauchy_rig.core.errors import ConvergenceError

BALL = Sphere(diameter_m=6e-3)


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a quarter of a coarse block."""
    return pad_model(brick_mesh((3, 3, 2), quarter=True), order=ElementOrder.P1)


def _touching(model: Model, depth_m: float) -> State:
    """Return the undeformed pad with the ball at a depth."""
    touch = touch_height(model, BALL, model.nodes, centre_m=(0.0, 0.0), rotation=np.eye(3))
    return model.rest_state(tip=np.array([0.0, 0.0, touch - depth_m]))


@pytest.mark.parametrize("way_m", [1e-6, 0.1e-3, 1e-3])
def test_the_indenter_goes_in_no_deeper_than_allowed(model: Model, way_m: float) -> None:
    """After the fraction of a way down no gap is below the share of the height; up is free."""
    state, still = _touching(model, 0.0), np.zeros_like(model.nodes)
    down = state.tip - np.array([0.0, 0.0, way_m])
    fraction = overlap_fraction(model, BALL, state, down, still)
    assert 0.0 < fraction <= 1.0
    state.tip = state.tip + fraction * (down - state.tip)
    allowed = OVERLAP_SHARE * model.height_m
    assert model.surface.gaps(model.nodes, BALL, state).min() >= -allowed * (1.0 + 1e-12)
    up = state.tip + np.array([0.0, 0.0, way_m])
    assert overlap_fraction(model, BALL, state, up, still) == 1.0


def test_a_slight_overlap_is_no_reason_to_refuse(model: Model) -> None:
    """Twice what is allowed between equilibria may begin, a third of the height may not."""
    refuse_deep_overlap(model, BALL, _touching(model, OVERLAP_SHARE * model.height_m))
    with pytest.raises(ConvergenceError, match="inside the indenter"):
        refuse_deep_overlap(model, BALL, _touching(model, model.height_m / 3.0))


@pytest.mark.parametrize("order", ElementOrder)
def test_upside_down_begins_at_rest_with_its_base_held(order: ElementOrder) -> None:
    """Mirrored in its base, the block comes back to rest, and under a ball to its force."""
    model = pad_model(brick_mesh((3, 3, 2)), order=order)
    found = []
    for depth_m, flip in ((-1e-3, -1.0), (0.2e-3, 1.0), (0.2e-3, -1.0)):
        state = _touching(model, depth_m)
        state.positions = model.nodes * [1.0, 1.0, flip]
        solver = EquilibriumSolver(model, BALL)
        found.append(solver.settle(state, options=SolverOptions()).push_n[2])
        np.testing.assert_array_equal(state.positions[model.clamped], model.nodes[model.clamped])
    assert found[0] == 0.0
    assert found[2] == pytest.approx(found[1], rel=1e-6)
