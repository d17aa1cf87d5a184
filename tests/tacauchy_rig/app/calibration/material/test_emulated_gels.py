"""Gels that were drawn: told within their intervals, from fine presses."""

from __future__ import annotations

import pytest

from tacauchy_rig.app.calibration.material.fit import respond
from tests.studies.gel.command import (
    BALL,
    DEPTHS_M,
    drawn_gel,
    gel_table,
    judged_gel,
    presses_of,
    true_area_m2,
)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_six_gels_under_a_ball() -> None:
    """Each of E, nu and mu in its interval; fine presses within 3 %."""
    response, gel = respond(presses_of(1, BALL)), drawn_gel(1)
    off = response.area_m2(gel.poisson, gel.friction, DEPTHS_M) / true_area_m2(BALL, gel, DEPTHS_M)
    assert off == pytest.approx(1.0, abs=0.03)
    judged = [judged_gel((seed, (BALL,)), responses={BALL: response}) for seed in range(1, 7)]
    table = gel_table(judged)
    assert len(table.rows) == 1
    assert table.passed, table.rows
