"""Verdicts follow from rules."""

from __future__ import annotations

import pytest

from sim.studies.paper.claims import Rule, Verdict, verdict


@pytest.mark.parametrize(
    ("rule", "paper", "ours", "expected"),
    [
        (Rule.COUNT, 1920.0, 1900.0, Verdict.REPRODUCED),
        (Rule.COUNT, 1920.0, 1369.0, Verdict.DIFFERENT),
        (Rule.COUNT, 1920.0, 2500.0, Verdict.DIFFERENT),
        (Rule.AT_MOST, 5.0, 5.0, Verdict.REPRODUCED),
        (Rule.AT_MOST, 5.0, 0.0, Verdict.REPRODUCED),
        (Rule.AT_MOST, 5.0, 5.1, Verdict.DIFFERENT),
        (Rule.AT_LEAST, 555.0, 500.0, Verdict.DIFFERENT),
        (Rule.AT_LEAST, 555.0, 1600.0, Verdict.REPRODUCED),
        (Rule.AT_LEAST, 555.0, 1700.0, Verdict.BETTER),
        (Rule.TIME, 1.0, 1.1, Verdict.DIFFERENT),
        (Rule.TIME, 1.0, 0.5, Verdict.REPRODUCED),
        (Rule.TIME, 1.0, 0.2, Verdict.BETTER),
        (Rule.SCORE, 0.93, 0.925, Verdict.REPRODUCED),
        (Rule.SCORE, 0.93, 0.95, Verdict.BETTER),
        (Rule.SCORE, 0.93, 0.91, Verdict.DIFFERENT),
        (Rule.DECIBEL, 22.0, 20.0, Verdict.DIFFERENT),
        (Rule.SQUARES, 400.0, 200.0, Verdict.BETTER),
        (Rule.SQUARES, 400.0, 450.0, Verdict.REPRODUCED),
        (Rule.SQUARES, 400.0, 600.0, Verdict.DIFFERENT),
        (Rule.CRITERIA, 1.0, 1.0, Verdict.REPRODUCED),
        (Rule.CRITERIA, 1.0, 0.75, Verdict.DIFFERENT),
        (Rule.SCORE, 0.93, None, Verdict.NOT_REPRODUCED),
        (Rule.SCORE, 0.93, float("nan"), Verdict.NOT_REPRODUCED),
    ],
)
def test_rule(rule: Rule, paper: float, ours: float | None, expected: Verdict) -> None:
    """Within the tolerance, beyond it on either side, and without a number of ours."""
    assert verdict(rule, paper, ours) is expected
