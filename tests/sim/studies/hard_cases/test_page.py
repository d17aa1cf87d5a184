"""The page of the hard cases."""

from __future__ import annotations

import pytest

from sim.studies.hard_cases.case import CaseResult
from sim.studies.hard_cases.catalogue import all_cases, select_cases
from sim.studies.hard_cases.page import markdown, summary_line
from tacauchy_rig.errors import ConfigError

GOOD = CaseResult(
    number=1,
    name="flat start",
    criterion="back to rest",
    passed=True,
    measured={"iterations": 7, "distance_over_H": 3.25e-13, "same": True},
    wall_s=2.4,
)
BAD = CaseResult(
    number=4, name="80 %", criterion="converged", passed=False, failure="stopped at 3.1 mm"
)


def test_page_has_criterion_numbers_verdict_and_command() -> None:
    """What was asked, what came out, and what made it."""
    page = markdown([GOOD, BAD], command="tacauchy-rig torture", versions={"numpy": "2.1"})
    assert "**1 of 2 hard cases pass; failed: 4.**" in page
    assert "Written by `tacauchy-rig torture` with numpy 2.1" in page
    assert "2 of the 19 cases are on this page" in page
    assert "| 1 | flat start | pass | 2 |" in page
    assert r"| distance\_over\_H | 3.25e-13 |" in page
    assert "| same | yes |" in page
    assert "## 4. 80 %: FAIL" in page
    assert "No numbers: stopped at 3.1 mm" in page


def test_summary_of_success() -> None:
    """Nothing is said to have failed."""
    assert summary_line([GOOD]) == "1 of 1 hard cases pass."


def test_numbers_are_unique_and_rows_are_selected() -> None:
    """A number names one case; an unknown one is refused with those that exist."""
    numbers = [case.number for case in all_cases()]
    assert numbers == sorted(set(numbers))
    assert [case.number for case in select_cases([14, 1])] == [1, 14]
    with pytest.raises(ConfigError, match="no hard case 20") as error:
        select_cases([20])
    assert "1, 2" in error.value.remedy
