"""Punch and ball on a bonded layer, on preset fast: what holds, and that it can be missed."""

from __future__ import annotations

import pytest

from sim.scene.scene import Preset
from sim.studies.verification.forces import measure_ball, measure_punch


def test_punch_states_error_and_limit_of_each_row() -> None:
    """A row's error is that of its forces, and the verdict is whether all are within limits."""
    found = measure_punch(preset=Preset.FAST, allowed=((0.45, 0.05),))
    _, _, force, exact, error, limit = found.rows[0]
    assert isinstance(force, float)
    assert isinstance(exact, float)
    assert error == pytest.approx(100.0 * (force / exact - 1.0))
    assert limit == 5.0
    assert found.passed


def test_a_limit_that_is_not_met_is_missed() -> None:
    """The verdict follows the numbers."""
    assert not measure_punch(preset=Preset.FAST, allowed=((0.45, 1e-9),)).passed


def test_ball_is_compared_with_hertz_where_the_pad_is_thick() -> None:
    """Thick: Hertz and layer are near each other; thin: the layer alone is to be met."""
    found = measure_ball(preset=Preset.FAST, presses=((15e-3, 20e-6), (2e-3, 40e-6)))
    thick, thin = found.rows
    assert abs(float(thick[4] or 0.0) / float(thick[6] or 1.0) - 1.0) < 0.02
    assert abs(float(thin[5] or 0.0)) > 5.0
    assert abs(float(thin[7] or 100.0)) < 5.0
