"""Measurements in processes of their own."""

from __future__ import annotations

import os

import pytest

from tacauchy_rig.cli.side_by_side import side_by_side
from tacauchy_rig.errors import ConfigError


def _process_of(name: str) -> tuple[str, int]:
    return name, os.getpid()


def _refuse(name: str) -> str:
    raise ConfigError(f"{name} is refused", remedy="do not ask")


def test_results_keep_their_order_and_come_from_other_processes() -> None:
    """Three names by two jobs: in order, none from this process."""
    found = list(side_by_side(_process_of, ["c", "a", "b"], jobs=2))
    assert [name for name, _ in found] == ["c", "a", "b"]
    assert all(name == told for name, (told, _) in found)
    assert os.getpid() not in {process for _, (_, process) in found}


def test_one_job_stays_in_this_process() -> None:
    """One at a time needs no other process."""
    found = list(side_by_side(_process_of, ["a", "b"], jobs=1))
    assert {process for _, (_, process) in found} == {os.getpid()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_arrives_as_it_was_raised(jobs: int) -> None:
    """The error of a measurement keeps its text and its remedy on the way back."""
    with pytest.raises(ConfigError, match="a is refused") as caught:
        list(side_by_side(_refuse, ["a", "b"], jobs=jobs))
    assert caught.value.remedy == "do not ask"
