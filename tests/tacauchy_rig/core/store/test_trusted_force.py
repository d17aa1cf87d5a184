"""Which attempts of a run are believed, by its journal and results."""

from dataclasses import replace
from pathlib import Path

import pytest

from protocols.trials.trial_sequence import plan_session
from tacauchy_rig.core.force_sensor_gain import FORCE_HISTORY
from tacauchy_rig.core.run import JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.json_codec import to_json
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series
from tests.recorded_run import empty_run
from tests.tacauchy_rig.core.test_force_sensor_gain import RIGHT, falling, pressed, weighed


@pytest.fixture
def store(tmp_path: Path) -> RunStore:
    """Return a new run's folder."""
    return empty_run(tmp_path)


def keep(store: RunStore, *records: TrialRecord) -> None:
    """Keep attempts as a session does."""
    for record in records:
        event = JournalEvent(
            stamp_ns=1, name="attempt-start", trial=record.index, attempt=record.attempt
        )
        append_event(store.paths.journal, event)
        store.paths.result(record.index, record.attempt).parent.mkdir(parents=True)
        store.save_result(record)


def weigh(store: RunStore, scale: float) -> None:
    """Check the cell by a weight of which it reads ``scale``."""
    detail = to_json(weighed(scale))
    append_event(store.paths.journal, JournalEvent(stamp_ns=1, name="force-check", detail=detail))


def left_to_press(store: RunStore) -> list[int]:
    """Return the trials that a resume would press."""
    return [planned.index for planned in plan_session(store) if not planned.done]


def test_trials_that_agree_are_safe_and_a_weight_at_the_end_counts(store: RunStore) -> None:
    """A check before the first trial says nothing of the end."""
    weigh(store, 1.0)
    keep(store, *pressed(RIGHT))
    assert force_series(store).weighed is None
    assert left_to_press(store) == []
    weigh(store, 1.01)
    series = force_series(store)
    assert series.weighed is not None
    assert not series.doubted


def test_a_sensor_that_failed_later_takes_earlier_trials_with_it(store: RunStore) -> None:
    """The attempt that found it stands apart; a resume presses all of them again."""
    first, second, third, *_ = pressed(RIGHT)
    fault = replace(third, outcome=Outcome.FAULT, limit="witness.gel", reason="too little")
    keep(store, first, second, fault)
    series = force_series(store)
    assert list(series.doubted) == [(1, 1), (2, 1)]
    criterion = series.criterion(1, 1)
    assert criterion is not None
    assert not criterion.passed
    assert "too little" in criterion.remedy
    assert series.criterion(3, 1) is None
    assert left_to_press(store) == [1, 2, 3, 4, 5, 6]
    keep(store, replace(first, attempt=2))
    assert left_to_press(store) == [2, 3, 4, 5, 6]


def test_a_fault_that_says_nothing_of_the_sensor_leaves_earlier_trials_alone(
    store: RunStore,
) -> None:
    """Late images are no reason to doubt a force."""
    first, second, *_ = pressed(RIGHT)
    keep(store, first, replace(second, outcome=Outcome.FAULT, limit="limits.stale_image"))
    assert left_to_press(store) == [2, 3, 4, 5, 6]


def test_a_wrong_weight_at_the_end_dooms_the_trials_until_it_is_hung_again(store: RunStore) -> None:
    """A weight that swung is hung again; one that stays wrong is the sensor's."""
    keep(store, *pressed(RIGHT))
    weigh(store, 0.8)
    assert len(force_series(store).doubted) == 6
    assert "0.8 of that" in force_series(store).doubted[1, 1]
    weigh(store, 1.0)
    assert not force_series(store).doubted
    weigh(store, 0.8)
    keep(store, replace(pressed(RIGHT)[0], attempt=2))
    assert left_to_press(store) == [2, 3, 4, 5, 6]


def test_forces_that_contradict_each_other_are_found_in_the_folder_too(store: RunStore) -> None:
    """Results that each passed, as another version of this program may have left them."""
    keep(store, *pressed(falling(0.25)))
    series = force_series(store)
    assert series.history.fault
    assert len(series.doubted) == 6
    found = series.criterion(6, 1)
    assert found is not None
    assert found.name == FORCE_HISTORY
    assert found.measured > 1.0
