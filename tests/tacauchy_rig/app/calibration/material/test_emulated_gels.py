"""Five gels that were drawn: told within their intervals, whatever else is uncertain of a press."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sim.sensitivity import FINER, forces_at
from tacauchy_rig.app.calibration.material.fit import Response, fit_gel, gel_of, respond
from tests.studies.gel.command import (
    BALL,
    DEPTHS_M,
    PUNCH,
    Fitted,
    drawn_gel,
    fitted_gel,
    gel_table,
    presses_of,
)

SEEDS = range(1, 6)


@cache
def _response(indenter: str) -> Response:
    return respond(presses_of(1, indenter), correct=False)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_between_its_nodes_a_response_is_what_a_press_gives() -> None:
    """Of a punch to half a per cent."""
    presses = presses_of(1, PUNCH)
    area = _response(PUNCH).at(np.array([0.468]), np.array([0.2]), DEPTHS_M)[0, 0]
    scene = gel_of(presses.inputs, 0.468, 0.2).scene([1.0])
    pressed = forces_at(scene, DEPTHS_M.tolist(), refinement=FINER)
    young_pa = presses.inputs.sensor.material.young_pa
    np.testing.assert_allclose(young_pa * area, pressed, rtol=0.005)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_five_gels_under_two_indenters() -> None:
    """Each of E, nu and mu within its interval in four, and nine tenths of left-out presses."""
    tools = (BALL, PUNCH)
    responses = {tool: _response(tool) for tool in tools}
    fitted: list[Fitted] = []
    for seed in SEEDS:
        presses = {tool: presses_of(seed, tool) for tool in tools}
        fitted += fitted_gel(seed, presses, responses, sets=(tools,))
    table = gel_table(fitted)
    assert len(table.rows) == 1
    assert table.passed, table.rows


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_one_ball_does_not_tell_poissons_ratio() -> None:
    """Neither end of its interval is closed; the modulus is known no better than the valley."""
    for seed in SEEDS:
        fit = fit_gel([(presses_of(seed, BALL), _response(BALL))])
        assert not fit.poisson.is_bounded
        assert fit.young.holds(drawn_gel(seed).young_pa)
