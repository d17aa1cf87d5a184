"""How long a run still takes, by speeds first and by its own trials later."""

import pytest

from protocols.trials.time_left import TimeLeft, expected_duration_s
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import JournalEvent
from tests.protocols.conftest import fresh_plan


@pytest.fixture
def config():
    """Two trials."""
    return load_config(overrides=['protocol.force_targets=["1 N", "2 N"]']).config


def event(name, at_s, trial=0, attempt=1, **detail):
    """Return an event at a time [s]."""
    stamp_ns = round(at_s * 1e9)
    return JournalEvent(stamp_ns=stamp_ns, name=name, trial=trial, attempt=attempt, detail=detail)


def test_it_counts_down_and_ends_at_nothing(config):
    """Within a trial by the clock; nothing is left after the end, and before the run None."""
    left = TimeLeft(config, fresh_plan(config), None)
    assert left.seconds(0) is None
    left.note(event("run-start", 0.0))
    whole = left.seconds(0)
    assert whole > 2 * expected_duration_s(config, 1.0, None)
    left.note(event("attempt-start", 5.0, 1))
    assert left.seconds(8 * 10**9) == pytest.approx(left.seconds(5 * 10**9) - 3.0)
    left.note(event("run-end", 60.0))
    assert left.seconds(61 * 10**9) == 0.0


def test_a_trial_that_took_twice_as_long_doubles_the_next(config):
    """What was measured takes the place of what was planned."""
    plan = fresh_plan(config)
    left = TimeLeft(config, plan, None)
    took_s = 2.0 * expected_duration_s(config, plan[0].force_target_n, None)
    left.note(event("attempt-start", 0.0, 1))
    left.note(event("attempt-end", took_s, 1, outcome="passed"))
    next_s = 2.0 * expected_duration_s(config, plan[1].force_target_n, None)
    assert left.seconds(round(took_s * 1e9)) == pytest.approx(next_s)


def test_a_trial_that_failed_is_still_to_be_done(config):
    """Until its attempts are used up; how long one took that was cut off tells nothing."""
    plan = fresh_plan(config)
    left = TimeLeft(config, plan, None)
    left.note(event("attempt-start", 0.0, 1))
    whole_s = left.seconds(0)
    most = config.protocol.attempts
    for attempt in range(1, most + 1):
        left.note(event("attempt-start", attempt, 1, attempt))
        assert left.seconds(attempt * 10**9) == pytest.approx(whole_s)
        left.note(event("attempt-end", attempt, 1, attempt, outcome="failed"))
    second_s = expected_duration_s(config, plan[1].force_target_n, None)
    assert most > 1
    assert left.seconds(most * 10**9) == pytest.approx(second_s)


def test_what_an_earlier_session_did_takes_no_time(config):
    """Trials that are done are left out."""
    plan = fresh_plan(config)
    all_s = TimeLeft(config, plan, None)
    rest_s = TimeLeft(config, plan[1:], None)
    for each in (all_s, rest_s):
        each.note(event("run-start", 0.0))
    first_s = expected_duration_s(config, plan[0].force_target_n, None)
    assert all_s.seconds(0) - rest_s.seconds(0) == pytest.approx(first_s)
