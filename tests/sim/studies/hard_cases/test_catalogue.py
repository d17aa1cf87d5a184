"""The hard cases by number."""

from __future__ import annotations

import pytest

from sim.studies.hard_cases.case import HardCase
from sim.studies.hard_cases.catalogue import all_cases, select_cases
from tacauchy_rig.core.errors import ConfigError


def test_numbers_are_unique_and_rows_are_selected() -> None:
    """A number names one case; an unknown one is refused with those that exist."""
    numbers = [case.number for case in all_cases()]
    assert numbers == sorted(set(numbers))
    assert [case.number for case in select_cases([14, 1])] == [1, 14]
    with pytest.raises(ConfigError, match="no hard case 20") as error:
        select_cases([20])
    assert "1, 2" in error.value.remedy


@pytest.mark.slow
@pytest.mark.parametrize("case", all_cases(), ids=lambda case: case.name)
def test_every_case_meets_its_criterion(case: HardCase) -> None:
    """As `torture` measures them, which nobody runs as often."""
    outcome = case.measure()
    assert outcome.passed, outcome.measured
