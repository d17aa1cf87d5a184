"""The camera's shoulder: there and back, found from presses, kept in a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.optics.calibrate.colours import calibrate_optics
from sim.optics.calibrate.press_scene import seen_change
from sim.optics.colour.colour_model import LINEAR, Response
from sim.optics.colour.photometric import BALL_EXPONENTS
from tests.sim.optics.synthetic_presses import press_scene, presses, true_model


@given(st.floats(100.0, 254.0), st.floats(0.0, 254.5))
def test_light_shows_as_the_levels_that_it_was_read_from(knee: float, level: float) -> None:
    """Levels to light and back is nothing; the slope is that of the curve."""
    response, levels = Response(knee=knee), np.array([level])
    near = levels < 255.0 - min(0.4, 0.5 * (255.0 - knee))
    light = response.light(levels)
    np.testing.assert_allclose(response.levels(light)[near], levels[near], atol=1e-6)
    rise = response.levels(light + 1e-4) - response.levels(light - 1e-4)
    np.testing.assert_allclose(rise[near] / 2e-4, response.slope(levels)[near], atol=1e-3)


def test_the_last_levels_of_a_shoulder_only_bound_the_light() -> None:
    """A pixel near the end of a compressed range says that the light was at least so bright."""
    levels = np.array([[253, 240, 100]], dtype=np.uint8)
    seen = seen_change(levels, np.full((1, 3), 100.0), Response(knee=200.0))
    assert seen.over.tolist() == [[True, False, False]]
    assert seen.change[0, 2] == 0.0


@pytest.mark.slow
def test_presses_tell_where_the_shoulder_begins() -> None:
    """A knee in the middle of the presses' levels is found, and none where there is none."""
    bright = replace(true_model(), coefficients=4.0 * true_model().coefficients)
    bent = replace(bright, response=Response(knee=205.0))
    shown, _, _ = presses(10, model=bent, seed=4)
    scene = replace(press_scene(), exponents=BALL_EXPONENTS)
    found = calibrate_optics(shown, scene)
    assert found.model.response.knee == pytest.approx(205.0, abs=3.0)
    straight, _, _ = presses(10, model=bright, seed=4)
    found = calibrate_optics(straight, scene)
    assert found.model.response == LINEAR
