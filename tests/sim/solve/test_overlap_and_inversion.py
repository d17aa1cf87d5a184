"""Starts that overlap, or are inside out."""

import numpy as np
import pytest

from sim.contact.surface_and_grip import State
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Sphere
from sim.solve.loading_path import touch_height
from sim.solve.model import Model
from sim.solve.overlap_and_inversion import (
    OVERLAP_SHARE,
    inverted_share,
    overlap_fraction,
    refuse_deep_overlap,
    untangle,
)
from sim.studies.hard_cases.small_pads import brick_mesh, pad_model, quarter_brick_mesh
from tacauchy_rig.core.errors import ConvergenceError

BALL = Sphere(diameter_m=6e-3)


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a quarter of a coarse block."""
    return pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)


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


@pytest.fixture(scope="module", params=list(ElementOrder))
def whole_block(request: pytest.FixtureRequest) -> Model:
    """Return a coarse block, held at its base."""
    return pad_model(brick_mesh((3, 3, 2)), order=request.param)


def test_rest_and_turned_pads_are_not_tangled(whole_block: Model) -> None:
    """A rotation inverts nothing, a mirror everything."""
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0]])
    turned = whole_block.nodes @ np.vstack([turn, [0.0, 0.0, 1.0]]).T
    assert inverted_share(whole_block, whole_block.nodes) == 0.0
    assert inverted_share(whole_block, turned) == 0.0
    assert inverted_share(whole_block, whole_block.nodes * [1.0, 1.0, -1.0]) == 1.0


def test_upside_down_comes_back_with_its_base_held(whole_block: Model) -> None:
    """Mirrored in its base, the block is right way round after the passes; clamped nodes stay."""
    start = np.where(
        whole_block.clamped[:, None], whole_block.nodes, whole_block.nodes * [1.0, 1.0, -1.0]
    )
    positions, passes = untangle(whole_block, start)
    assert passes > 0
    assert inverted_share(whole_block, positions) < 1e-3
    np.testing.assert_allclose(
        positions[whole_block.clamped], whole_block.nodes[whole_block.clamped]
    )
