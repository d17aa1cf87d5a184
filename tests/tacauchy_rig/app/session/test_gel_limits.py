"""Limits that the cell could honour and the gel could not."""

from __future__ import annotations

import pytest

from tacauchy_rig.app.session.gel_limits import check_gel
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError


@pytest.mark.parametrize("sensor", ["gelsight-mini", "digit", "9dtact"])
def test_the_defaults_suit_every_built_in_gel(sensor: str) -> None:
    """Nobody has to correct a limit to press a sensor that is shipped."""
    assert "mm high" in check_gel(load_config(overrides=[f"sensor.name={sensor}"]).config)


def test_a_depth_through_the_gel_is_refused() -> None:
    """The gel's height and what may be written are named."""
    config = load_config(overrides=["sensor.name=digit", 'limits.max_depth="2.4 mm"']).config
    with pytest.raises(ConfigError) as caught:
        check_gel(config)
    assert caught.value.message == (
        "limits.max_depth: 2.4 mm is more than 80% of the gel of DIGIT, 2.5 mm high; write at "
        'most "2 mm"'
    )


def test_a_force_that_tears_the_gel_is_refused() -> None:
    """A thin indenter turns a small force into a large pressure."""
    config = load_config(overrides=['indenter.diameter="2 mm"']).config
    with pytest.raises(ConfigError) as caught:
        check_gel(config)
    assert "10 N under an indenter of 2 mm are 3.2 MPa" in caught.value.message
    assert 'write at most "6.83 N"' in caught.value.message
