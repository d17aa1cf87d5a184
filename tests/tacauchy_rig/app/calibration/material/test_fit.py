"""One indenter tells a valley, two that feel nu differently a gel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tacauchy_rig.app.calibration.material.fit import (
    NU,
    Data,
    fit_gel,
    held_count,
    interval,
    predict_held_out,
)
from tests.tacauchy_rig.app.calibration.material.made_up import made_presses, made_response

GEL = {"young_pa": 5e5, "poisson": 0.465, "friction": 0.4}
BALL = {"power": 1.5, "confined": 2.0}
PUNCH = {"power": 1.1, "confined": 9.0}


def _data(*kinds: tuple[str, dict[str, float]], seed: int = 1) -> Data:
    return [
        (made_presses(name, **GEL, **kind, seed=seed), made_response(**kind))
        for name, kind in kinds
    ]


ONE = ("sphere:diameter=6mm", BALL)
OTHER = ("cylinder:diameter=8mm,fillet=0.5mm", PUNCH)


def test_two_indenters_tell_a_gel() -> None:
    """All three within their intervals, the modulus to some per cent."""
    fit = fit_gel(_data(ONE, OTHER))
    assert fit.young.is_bounded
    assert fit.poisson.is_bounded
    assert fit.young.holds(GEL["young_pa"])
    assert fit.poisson.holds(GEL["poisson"])
    assert fit.friction.holds(GEL["friction"])
    assert (fit.young.uncertainty or 1e9) < 0.05 * GEL["young_pa"]


def test_one_indenter_tells_a_valley() -> None:
    """Any nu does; along the valley E goes as the formula has it. A stated nu picks one."""
    data = _data(ONE)
    fit = fit_gel(data)
    assert fit.poisson.low is None
    assert fit.poisson.high is None
    assert fit.poisson.uncertainty is None
    ends = fit.young_pa[[0, -1], fit.best[1]]
    assert ends[0] / ends[1] == pytest.approx(np.exp(2.0 * (NU[-1] - NU[0])), rel=0.02)
    told = fit_gel(data, prior=(GEL["poisson"], 0.005))
    assert told.poisson.is_bounded
    assert told.young.holds(GEL["young_pa"])
    assert (told.young.uncertainty or 1e9) < 0.5 * (fit.young.uncertainty or 1e9)


def test_depths_that_count_from_a_force_are_shifted_by_what_the_gel_gives() -> None:
    """Without it the same forces belong to a stiffer gel."""
    presses, response = _data(OTHER)[0]
    area = response.at(np.array([0.465]), np.array([0.4]), np.array([2e-5]))[0, 0, 0]
    later = replace(
        presses, contact_force_n=GEL["young_pa"] * float(area), depth_m=presses.depth_m - 2e-5
    )
    prior = (GEL["poisson"], 0.002)
    right, wrong = (
        fit_gel([(each, response)], prior=prior).young.best
        for each in (later, replace(later, contact_force_n=0.0))
    )
    assert right == pytest.approx(GEL["young_pa"], rel=0.03)
    assert wrong > 1.04 * right


def test_left_out_presses_lie_within_their_interval_and_a_wrong_one_does_not() -> None:
    """Of sixteen at least fourteen; a force that is a quarter too large is not believed."""
    data = _data(ONE, OTHER)
    held, count = held_count(list(predict_held_out(data, fit_gel(data))))
    assert count == 16
    assert held >= 14
    presses, response = data[1]
    force_n = presses.force_n.copy()
    force_n[4] *= 1.25
    spoiled = [(replace(presses, force_n=force_n), response), data[0]]
    predicted = predict_held_out(spoiled, fit_gel(spoiled))
    assert not next(each for each in predicted if each.force_n == force_n[4]).held


def test_an_interval_ends_where_the_profile_rises() -> None:
    """Of a parabola at 1.96 standard deviations; at an end of the range it stays open."""
    values = np.linspace(0.0, 10.0, 1001)
    found = interval(values, (values - 4.0) ** 2)
    assert (found.low, found.high) == pytest.approx((4.0 - 1.96, 4.0 + 1.96), abs=0.01)
    assert found.uncertainty == pytest.approx(1.0, abs=0.01)
    open_ended = interval(values, (values - 9.0) ** 2)
    assert open_ended.high is None
    assert open_ended.low == pytest.approx(9.0 - 1.96, abs=0.01)
