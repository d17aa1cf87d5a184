"""Which cases the fault table has, and how they are chosen."""

from __future__ import annotations

import pytest

from drivers.emulators.faults import FAULTS_OF_DEVICE
from tacauchy_rig.core.errors import ConfigError
from tests.studies.fault_table.cases import (
    Crowd,
    Moment,
    Rival,
    Trouble,
    Victim,
    all_cases,
    select_cases,
)


def test_every_fault_and_every_process_is_there_at_every_moment():
    """Nothing that an emulator can be told to do is left out."""
    cases = all_cases()
    fault_count = sum(len(kinds) for kinds in FAULTS_OF_DEVICE.values()) - 1  # unlocking mends
    others = 2 * len(Victim) + 1 + len(Trouble) + len(Rival) + len(Crowd)  # one process hangs
    later = [case for case in cases if case.moment is not Moment.START]
    assert len(later) == (fault_count + others) * 3
    assert len({case.slug for case in cases}) == len(cases)


def test_a_sensor_that_lies_does_so_from_the_start_at_each_target():
    """Six lies at six targets, and no other fault."""
    cases = [case for case in all_cases() if case.moment is Moment.START]
    assert len(cases) == 36
    assert {case.target_n for case in cases} == {1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332}
    assert "force_sensor:scale@start-4.7332N" in {case.name for case in cases}


@pytest.mark.parametrize(
    ("only", "moments", "names"),
    [
        (["kill:camera@dwell"], [], ["kill:camera@dwell"]),
        (["kill:c*"], [Moment.PRESS], ["kill:control@press", "kill:camera@press"]),
        (["camera:unplug", "robot:stall@search"], [Moment.SEARCH], None),
    ],
)
def test_cases_are_chosen_by_pattern_and_moment(only, moments, names):
    """Patterns match the whole name or the cause alone."""
    found = [case.name for case in select_cases(all_cases(), only=only, moments=moments)]
    assert found == (names if names is not None else ["robot:stall@search", "camera:unplug@search"])


def test_a_pattern_that_matches_nothing_is_refused():
    """A misspelt pattern is no table without problems, not even beside one that matches."""
    with pytest.raises(ConfigError, match="--only 'kill:camra': no such case") as caught:
        select_cases(all_cases(), only=["kill:c*", "kill:camra"])
    assert "fault-table --list" in caught.value.remedy
    with pytest.raises(ConfigError, match="no such case at press"):
        select_cases(all_cases(), only=["*@dwell"], moments=[Moment.PRESS])
