"""A sensor's file gets the gel that was told; a dwell that relaxes is told from one that not."""

from __future__ import annotations

import numpy as np
import pytest

from sim.sensor.sensor import parse_sensor
from tacauchy_rig.app.calibration.material.fit import Interval
from tacauchy_rig.app.calibration.material.results import fit_term, sensor_text, with_gel
from tacauchy_rig.core.errors import ConfigError

YOUNG = Interval(best=4.1e5, low=3.9e5, high=4.3e5)


def test_what_is_told_is_written_and_the_rest_stays() -> None:
    """The modulus with a standard uncertainty; Poisson's ratio, open above, as it was."""
    before = sensor_text("gelsight-mini")
    after = with_gel(
        before, young=YOUNG, poisson=Interval(best=0.48, low=0.46, high=None), source="made up"
    )
    old, new = (parse_sensor(text, origin="made up") for text in (before, after))
    assert new.material.young_pa == pytest.approx(4.1e5)
    assert new.numbers["material.young"].uncertainty == pytest.approx(0.2e5 / 1.96, rel=0.05)
    assert new.numbers["material.young"].source == "made up"
    assert new.material.poisson == old.material.poisson
    assert len(set(before.splitlines()) ^ set(after.splitlines())) == 2


def test_a_file_without_such_a_line_is_refused() -> None:
    """A gel of layers, or one that is written otherwise."""
    with pytest.raises(ConfigError, match="0 lines"):
        with_gel("[material]\n", young=YOUNG, poisson=YOUNG, source="made up")


TIME_S = np.tile(np.linspace(0.0, 2.0, 200), 6)
NOISE = 0.002 * np.random.default_rng(3).standard_normal(len(TIME_S))


def test_share_and_time_are_found() -> None:
    """3 % in 0.4 s, under noise of 0.2 %."""
    found = fit_term(TIME_S, 1.0 + 0.03 * np.exp(-TIME_S / 0.4) + NOISE)
    assert found is not None
    assert found.share == pytest.approx(0.03, abs=3.0 * found.share_error)
    assert found.time_s == pytest.approx(0.4, abs=3.0 * found.time_error_s)
    assert found.share_error < 0.002


@pytest.mark.parametrize("rising", [0.0, 0.005])
def test_noise_and_a_rising_force_tell_none(rising: float) -> None:
    """A servo that still pushes is no relaxation."""
    assert fit_term(TIME_S, 1.0 + rising * TIME_S + NOISE) is None
    assert fit_term(TIME_S[:5], np.ones(5)) is None
