"""Two commits beside each other, from made-up rows."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tacauchy_rig.core.errors import ConfigError
from tests.sim.studies.bench.test_scenes import _PRESS, _row
from tests.studies.compare.command import checked_out, pairs_table


def test_commits_stand_beside_each_other() -> None:
    """Their ratio of time, and how far their forces are apart."""
    slower = _row(replace(_PRESS, cpu_s=0.3))
    table = pairs_table([(_row(), slower)], commit="abc")
    assert table.title == "Beside commit abc"
    assert table.rows[0][-2:] == (pytest.approx(1.5), "0.0e+00")


def test_a_commit_that_is_none_is_refused() -> None:
    """The message is git's, the remedy ours."""
    with pytest.raises(ConfigError, match="git worktree"), checked_out("no-such-commit"):
        pass
