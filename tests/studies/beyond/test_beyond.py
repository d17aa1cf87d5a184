"""Presses beyond what a gel can bear, in short: one of each answer."""

from dataclasses import replace

import pytest

from sim.press_arguments import scene_from
from tacauchy_rig.core.study import Result
from tests.studies.beyond.command import Answer, Beyond, BeyondStudy, Kind, drawn, judged

BALL = scene_from(
    "--pad box:10x10x4mm --young 0.2MPa --poisson 0.48 --preset fast "
    "--indenter sphere:diameter=8mm --depth 2mm"
)
DEEP = Beyond(kind=Kind.LARGE_BALL, scene=replace(BALL, refinement=0.5))
STUDY = BeyondStudy(count=3, seed=1, limit_s=60.0, finer_limit_s=60.0)


@pytest.fixture(scope="module")
def deep():
    """A ball pressed by half of the gel, on a coarse mesh, and what came of it."""
    return judged(DEEP, limit_s=60.0, finer_limit_s=60.0)


def test_a_ball_that_a_gel_can_bear_is_answered_rightly(deep):
    """Held against a finer mesh; without the time for one it is undecided, which is listed."""
    assert deep["answer"] == Answer.RIGHT, deep
    assert STUDY.has_passed([_result(deep)])
    undecided = judged(DEEP, limit_s=60.0, finer_limit_s=1e-6)
    assert undecided["answer"] == Answer.UNDECIDED
    _, listed = STUDY.tables([_result(deep), _result(undecided)])
    assert len(listed.rows) == 1


def test_what_no_gel_bears_is_refused_and_what_takes_long_ends():
    """A huge load at once; another by its limit."""
    huge = next(case for n in range(7, 100, 9) if _is_huge(case := drawn(1, n)))
    refused = judged(huge, limit_s=60.0, finer_limit_s=60.0)
    assert refused["answer"] == Answer.REFUSED, refused
    assert "more than the gel can carry" in refused["said"]
    late = judged(DEEP, limit_s=1e-6, finer_limit_s=1.0)
    assert late["answer"] == Answer.LATE


def _is_huge(case):
    return case.kind is Kind.HUGE and case.scene.target.force_n > 3e3


def test_a_wrong_answer_a_long_silence_or_a_crash_misses_the_criterion(deep):
    """Of one press among others."""
    for missed in ({"answer": Answer.WRONG}, {"answer": Answer.HELPLESS}, {"silent_s": 6.0}):
        assert not STUDY.has_passed([_result(deep), _result(deep | missed)])
    assert not STUDY.has_passed([_result(deep), Result(name="1", failure="its process ended")])


def test_each_press_has_a_process_and_a_limit_of_its_own():
    """Which end it where its own limit does not."""
    cases = STUDY.cases()
    longest_s = 6.0 * (60.0 + 2.0 * 60.0)  # the press, and the two that may judge it
    assert all(case.is_isolated and case.limit_s <= longest_s for case in cases)
    assert len({case.shows for case in cases}) == len(cases)


def _result(found):
    return Result(name="0", shows="a press", found=found)
