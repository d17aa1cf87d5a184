"""A sensor's file gets the gel that was told, and nothing else."""

from __future__ import annotations

import pytest

from sim.sensor.sensor import parse_sensor
from tacauchy_rig.app.calibration.material.fit import Interval
from tacauchy_rig.app.calibration.material.results import sensor_text, with_gel
from tacauchy_rig.core.errors import ConfigError

YOUNG = Interval(best=4.1e5, low=3.9e5, high=4.3e5)


def test_what_is_told_is_written_and_the_rest_stays() -> None:
    """The modulus with a standard uncertainty; Poisson's ratio, open above, as it was."""
    before = sensor_text("gelsight-mini")
    after = with_gel(
        before,
        young=YOUNG,
        poisson=Interval(best=0.48, low=0.46, high=None),
        source="made up",
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
