"""A folder of runs is found, or refused with what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from tacauchy_rig.app.results.runs import ListedRun, differing, find_runs, folder_of_runs
from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.results.made_runs import NAMES
from tests.tacauchy_rig.core.store.test_force_series import keep, weigh
from tests.tacauchy_rig.core.test_force_history import RIGHT, pressed


def test_a_run_alone_is_found_in_its_folder(runs: Path) -> None:
    """The folder around it, and its name."""
    assert folder_of_runs(runs) == (runs, "")
    assert folder_of_runs(runs / NAMES[0]) == (runs, NAMES[0])


@pytest.mark.parametrize(("name", "word"), [("absent", "no such folder"), ("notes", "no run")])
def test_where_no_run_lies_the_remedy_is_told(runs: Path, name: str, word: str) -> None:
    """What is wrong, and which command makes a run."""
    with pytest.raises(ConfigError, match=word) as caught:
        folder_of_runs(runs / name)
    assert "tacauchy-rig" in caught.value.remedy


def test_presses_of_a_sensor_that_was_wrong_afterwards_are_not_counted(tmp_path: Path) -> None:
    """They passed, and are to be pressed again."""
    store = RunStore.create(
        tmp_path, load_config(), config_text=default_text(), simulated=True, versions={}
    )
    keep(store, *pressed(RIGHT))
    assert find_runs(tmp_path)[0].passed_count == 6
    weigh(store, 0.8)
    (found,) = find_runs(tmp_path)
    assert (found.passed_count, found.forces_n) == (0, None)
    assert found.next_command.startswith("tacauchy-rig resume")


def listed(name: str, *met: bool) -> ListedRun:
    """Return a run whose presses met one criterion or did not, and all met another."""
    trials = [
        {
            "index": k,
            "criteria": [
                {"name": "force_margin", "passed": passed},
                {"name": "press", "passed": True},
            ],
        }
        for k, passed in enumerate(met, 1)
    ]
    return ListedRun(name=name, folder=Path(name), summary={"trials": trials, "criteria": "?"})


def test_criteria_that_differ_are_named() -> None:
    """With in how many presses each was met; what both met is left out."""
    assert differing(listed("a", True, True), listed("b", True, False)) == [
        ("force margin", "met in 2 of 2", "met in 1 of 2")
    ]
    assert differing(listed("a", True), listed("b", True, True)) == []
