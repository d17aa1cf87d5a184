"""Presses beyond what a gel can bear, in short: one of each answer."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.press_command import scene_from
from tests.studies.beyond.command import Answer, Beyond, Kind, answers_table, drawn, judged, line

BALL = scene_from(
    "--pad box:10x10x4mm --young 0.2MPa --poisson 0.48 --preset fast "
    "--indenter sphere:diameter=8mm --depth 2mm"
)
DEEP = Beyond(number=0, kind=Kind.LARGE_BALL, scene=replace(BALL, refinement=0.5))


@pytest.fixture(scope="module")
def deep():
    """A ball pressed by half of the gel, on a coarse mesh, and what came of it."""
    return judged(DEEP, limit_s=60.0, finer_limit_s=60.0)


def test_a_ball_that_a_gel_can_bear_is_answered_rightly(deep):
    """Held against a finer mesh."""
    assert deep.answer is Answer.RIGHT, line(deep)
    assert deep.is_met


def test_what_no_gel_bears_is_refused_and_what_takes_long_ends():
    """A huge load at once; another by its limit."""
    huge = next(case for n in range(7, 100, 9) if _is_huge(case := drawn(1, n)))
    refused = judged(huge, limit_s=60.0, finer_limit_s=60.0)
    assert refused.answer is Answer.REFUSED, line(refused)
    assert "more than the gel can carry" in refused.said
    late = judged(DEEP, limit_s=1e-6, finer_limit_s=1.0)
    assert late.answer is Answer.LATE


def _is_huge(case):
    return case.kind is Kind.HUGE and case.scene.target.force_n > 3e3


def test_a_wrong_answer_or_a_long_silence_misses_the_criterion(deep):
    """Of one press among others."""
    for missed in (replace(deep, answer=Answer.WRONG), replace(deep, silent_s=6.0)):
        assert not answers_table([deep, missed], command="").passed
    assert answers_table([deep], command="").passed
