"""A few dozen of the states of the study "power-cuts"."""

import pytest

from tests.studies.power_cuts.command import observe, recorded_history
from tests.studies.power_cuts.states import History


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> History:
    """A run of two sessions."""
    return recorded_history(tmp_path_factory.mktemp("runs"))


def test_every_state_has_a_way_forward(history: History) -> None:
    """Finished recordings stay, nothing contradicts anything, and the next attempt is free."""
    seen = [observe(number, history=history, seed=2) for number in range(1, 13)]
    assert [each for each in seen if each.failures] == []


def test_a_resumed_state_comes_to_its_end(history: History) -> None:
    """State 0 is pressed until both trials have passed."""
    assert observe(0, history=history, seed=2).failures == ()
