"""A pad that is turned inside out finds its way back."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.elements import ElementOrder
from sim.solve.model import Model
from sim.solve.starts import inverted_share, untangle
from sim.studies.hard_cases.pads import brick_mesh, pad_model


@pytest.fixture(scope="module", params=list(ElementOrder))
def model(request: pytest.FixtureRequest) -> Model:
    """Return a coarse block, held at its base."""
    return pad_model(brick_mesh((3, 3, 2)), order=request.param)


def test_rest_and_turned_pads_are_not_tangled(model: Model) -> None:
    """A rotation inverts nothing, a mirror everything."""
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0]])
    turned = model.nodes @ np.vstack([turn, [0.0, 0.0, 1.0]]).T
    assert inverted_share(model, model.nodes) == 0.0
    assert inverted_share(model, turned) == 0.0
    assert inverted_share(model, model.nodes * [1.0, 1.0, -1.0]) == 1.0


def test_upside_down_comes_back_with_its_base_held(model: Model) -> None:
    """Mirrored in its base, the block is right way round after the passes; clamped nodes stay."""
    start = np.where(model.clamped[:, None], model.nodes, model.nodes * [1.0, 1.0, -1.0])
    positions, passes = untangle(model, start)
    assert passes > 0
    assert inverted_share(model, positions) < 1e-3
    np.testing.assert_allclose(positions[model.clamped], model.nodes[model.clamped])
