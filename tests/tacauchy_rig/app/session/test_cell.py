"""What a run asks of cell and gel before it presses, and what it notes."""

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

from tacauchy_rig.app.replay.simulator_inputs import check_gel
from tacauchy_rig.app.session import record_run_and_weight_check as loop_expected
from tacauchy_rig.app.session.record_run_and_weight_check import (
    ForceCheckError,
    check_cell,
    expected_press,
    kept_expectation,
    mark_expired,
    needs_weight,
    note_changes,
    require_bounded_force,
    standing_check,
)
from tacauchy_rig.core.config.load import Change, load_config
from tacauchy_rig.core.errors import ConfigError, ConvergenceError
from tacauchy_rig.core.known_weight import Weight
from tacauchy_rig.core.run import Tare
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.run_store import RunStore

WEIGHT = Weight(mass_kg=0.2, uncertainty_kg=0.002)


@pytest.fixture
def store(new_store: Callable[..., RunStore]) -> RunStore:
    """Return a new run's folder."""
    return new_store()


def tare(fz_n: float) -> Tare:
    """Return a reading of the cell."""
    mean = (0.0, 0.0, fz_n, 0.0, 0.0, 0.0)
    return Tare(start_ns=0, end_ns=1, mean=mean, deviation=(0.004,) * 6, sample_count=200)


def weighs(monkeypatch: pytest.MonkeyPatch, scale: float) -> None:
    """Let the cell read ``scale`` of what hangs on it."""
    readings = (tare(1.4), tare(1.4 - scale * WEIGHT.force_n), tare(1.4))
    monkeypatch.setattr(
        "tacauchy_rig.app.session.record_run_and_weight_check.weigh", lambda _config, **_: readings
    )


def _journalled(store: RunStore) -> int:
    return [event.name for event in Journal.read(store.paths.journal).events].count("force-check")


def test_a_right_cell_is_kept_and_stands(store: RunStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file, the journal and a resume agree."""
    assert "force not checked" in standing_check(store)
    weighs(monkeypatch, 1.01)
    check = check_cell(store, store.config, WEIGHT, ask=lambda _: None)
    assert store.force_check.load() == check
    assert _journalled(store) == 1
    assert not standing_check(store)


def test_a_wrong_cell_refuses_the_run_until_it_is_right(
    store: RunStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was found is kept; the run goes on only after a check that passed."""
    weighs(monkeypatch, 0.1)
    with pytest.raises(ForceCheckError, match=r"0\.1 of that") as caught:
        check_cell(store, store.config, WEIGHT, ask=lambda _: None)
    assert caught.value.exit_code == 2
    assert "a tenth" in caught.value.remedy
    with pytest.raises(ForceCheckError, match="sensor was wrong at its last check") as caught:
        require_bounded_force(store, store.config)
    assert "--check-weight 200g" in caught.value.remedy
    weighs(monkeypatch, 1.0)
    check_cell(store, store.config, WEIGHT, ask=lambda _: None)
    require_bounded_force(store, store.config)
    assert not standing_check(store)
    assert _journalled(store) == 2


def test_a_check_expires(store: RunStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a day it is marked, so that the report says what was pressed without it."""
    weighs(monkeypatch, 1.0)
    check = check_cell(store, store.config, WEIGHT, ask=lambda _: None)
    made = datetime.fromisoformat(check.checked)
    assert not standing_check(store, now=made + timedelta(hours=23.9))
    later = made + timedelta(hours=24.1)
    assert "has expired" in standing_check(store, now=later)
    mark_expired(store, now=made)
    assert store.force_check.load() == check
    mark_expired(store, now=later)
    assert store.force_check.load() == replace(check, expired=later.isoformat(timespec="seconds"))


def test_an_arm_that_hardly_feels_presses_only_by_a_checked_cell(
    new_store: Callable[..., RunStore], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refused before anything is connected; a weight or a setting admits it."""
    coarse = 'robot.model="cb3"'
    store = new_store(coarse)
    with pytest.raises(ForceCheckError, match=r"robot\.model cb3 feels force to 7\.5 N") as caught:
        require_bounded_force(store, store.config)
    assert "more than 2.38 N; nothing moved" in caught.value.message
    assert "--check-weight 200g" in caught.value.remedy
    assert "limits.allow_unchecked_force = true" in caught.value.remedy
    weighs(monkeypatch, 1.0)
    check = check_cell(store, store.config, WEIGHT, ask=lambda _: None)
    require_bounded_force(store, store.config)
    old = datetime.fromisoformat(check.checked) - timedelta(hours=25)
    store.force_check.save(replace(check, checked=old.isoformat()))
    with pytest.raises(ForceCheckError, match="has expired"):
        require_bounded_force(store, store.config)
    admitted = new_store(coarse, "run.name=admitted", "limits.allow_unchecked_force=true")
    require_bounded_force(admitted, admitted.config)


@pytest.mark.parametrize(("target", "needs"), [("0.42 N", True), ("0.44 N", False), ("4 N", False)])
def test_an_arm_that_feels_bounds_all_but_the_smallest_target(target: str, needs: bool) -> None:
    """An e-Series: 1.5 T + 0.5 N less T are 0.6 N and a tenth of the first at T = 0.43 N."""
    config = load_config(overrides=[f'protocol.force_targets=["4.7 N", "{target}"]']).config
    assert needs_weight(config) is needs


def test_what_was_changed_stands_in_the_journal(new_store: Callable[..., RunStore]) -> None:
    """Old and new value, and run.json stays as it was recorded."""
    store = new_store()
    before = store.paths.run_json.read_bytes()
    note_changes(store, ())
    note_changes(store, [Change(field="limits.stale_image", old="500 ms", new="1 s")])
    (event,) = [e for e in Journal.read(store.paths.journal).events if e.name == "resume-set"]
    assert event.detail == {
        "changes": [{"field": "limits.stale_image", "old": "500 ms", "new": "1 s"}]
    }
    assert store.paths.run_json.read_bytes() == before


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


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (
            ["sensor.name=digit", 'limits.max_depth="2.4 mm"'],
            "limits.max_depth: 2.4 mm is more than 80% of the gel of DIGIT, 2.5 mm high; write at",
        ),
        (["sensor.name=digit", 'limits.max_depth="2.4 mm"'], 'write at most "2 mm"'),
        (['indenter.diameter="2 mm"'], "10 N under an indenter of 2 mm are 3.2 MPa"),
        (['indenter.diameter="2 mm"'], 'write at most "6.83 N"'),
    ],
)
def test_what_goes_through_or_tears_the_gel_is_refused(overrides: list[str], told: str) -> None:
    """What may be written is named; a thin indenter turns a small force into a large pressure."""
    with pytest.raises(ConfigError) as caught:
        check_gel(load_config(overrides=overrides).config)
    assert told in caught.value.message
