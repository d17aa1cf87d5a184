"""What a press should give, by the simulator, and limits that the gel would not survive."""

from __future__ import annotations

import numpy as np
import pytest

from tacauchy_rig.app.session import expected as loop_expected
from tacauchy_rig.app.session.expected import expected_press, kept_expectation
from tacauchy_rig.app.session.gel_limits import check_gel
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError, ConvergenceError


@pytest.fixture(scope="module")
def mini():
    """Return the default rig's expectation."""
    return expected_press(load_config().config)


def test_the_curve_is_that_of_the_stated_gel(mini):
    """2 N at 0.34 mm into a GelSight Mini; the curve rises and goes beyond the largest target."""
    assert mini.sensor == "gelsight-mini"
    assert mini.depth_m[0] == mini.force_n[0] == 0.0
    assert np.all(np.diff(mini.depth_m) > 0.0)
    assert np.all(np.diff(mini.force_n) > 0.0)
    assert np.interp(2.0, mini.force_n, mini.depth_m) == pytest.approx(0.343e-3, rel=0.05)
    assert mini.force_n[-1] > 4.7332 / mini.low


def test_the_factors_come_from_what_the_sensor_file_states(mini):
    """A gel 20 % off lies inside, half the force in a stiff gel outside."""
    assert mini.low < 0.8
    assert mini.high > 1.2
    assert mini.low > 0.5 * 1.2
    assert mini.gel_height_m == 4e-3
    assert mini.lean_m == pytest.approx(2.4e-3 * np.sin(np.radians(2.0)))


@pytest.mark.parametrize("name", ["digit", pytest.param("9dtact", marks=pytest.mark.slow)])
def test_an_uncertain_gel_has_a_wide_band(name):
    """Their moduli are assumptions: a curve of theirs hardly bounds the force, and says so."""
    wide = expected_press(
        load_config(
            overrides=[
                f'sensor.name="{name}"',
                'protocol.force_targets=["0.3 N"]',
                'indenter.kind="sphere"',
                'indenter.fillet="0 mm"',
            ]
        ).config
    )
    assert wide.high > 2.0
    assert wide.low < 0.5
    assert wide.lean_m == 0.0


def test_it_is_made_once_a_run(mini, new_store, monkeypatch):
    """The second time it is read from the folder, equal in every digit."""
    store = new_store()
    monkeypatch.setattr(loop_expected, "expected_press", lambda _config: mini)
    assert kept_expectation(store) == mini
    monkeypatch.setattr(loop_expected, "expected_press", lambda _config: None)
    assert kept_expectation(store) == mini


def test_a_press_that_cannot_be_simulated_leaves_the_other_witnesses(new_store, monkeypatch):
    """The run goes on, and keeps no expectation."""
    store = new_store()

    def fail(_config):
        raise ConvergenceError("no equilibrium")

    monkeypatch.setattr(loop_expected, "expected_press", fail)
    assert kept_expectation(store) is None
    assert not store.paths.expected.exists()


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
