"""Study "sweep-kills" in its reduced form."""

from __future__ import annotations

import pytest

from tacauchy_rig.core.study import measured
from tests.studies.sweep_kills.command import SweepKills


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_no_press_is_lost_or_computed_twice() -> None:
    """Every engine comes to the files of a sweep that was left alone."""
    study = SweepKills(12, seed=1)
    results = list(measured(study.cases()))
    assert study.has_passed(results), study.tables(results)[0].rows
