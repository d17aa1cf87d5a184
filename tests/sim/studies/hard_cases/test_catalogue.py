"""The hard cases: their rows and page, from made-up results; all of them if time is given."""

from __future__ import annotations

from typing import Any

import pytest

from sim.studies.hard_cases.study import MEASURES, HardCases
from tacauchy_rig.core.study import About, Result

NAMES = {case.alias: case.name for case in HardCases().cases()}


def result(number: str, **measured: Any) -> Result:
    """Return a case that passed with some numbers."""
    found = {"passed": True, "measured": measured}
    return Result(name=NAMES[number], shows="it ends", found=found, wall_s=2.4)


# Kernels in single precision (13) end in NaN on some processors, and meet the criterion on others.
_BY_PROCESSOR = pytest.mark.xfail(reason="float32 kernels: NaN on some processors", strict=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [pytest.param(n, marks=_BY_PROCESSOR) if str(n) == "13" else n for n in MEASURES],
)
def test_every_case_meets_its_criterion(number: str) -> None:
    """As `study hard-cases` measures them, which nobody runs as often."""
    outcome = MEASURES[number]()
    assert outcome.passed, outcome.measured


def test_page_has_criterion_numbers_verdict_and_command() -> None:
    """What was asked, what came out, and what made it; a case without numbers has failed."""
    good = result("1", iterations=7, distance_over_H=3.25e-13, same=True)
    bad = Result(name=NAMES["4"], shows="converged", failure="stopped at 3.1 mm")
    study = HardCases()
    page = study.page([good, bad], About("tacauchy-rig study hard-cases"), [])
    assert "**1 of 2 hard cases pass; failed: 4.**" in page
    assert "Written by `tacauchy-rig study hard-cases` with tacauchy-rig" in page
    assert "2 of the 19 cases are on this page" in page
    assert f"| 1 | {NAMES['1']} | pass | 2 |" in page
    assert "| distance_over_H | 3.25e-13 |" in page
    assert "| same | yes |" in page
    assert f"## 4. {NAMES['4']}: FAIL" in page
    assert "No numbers: stopped at 3.1 mm" in page
    first, second = study.facts([good, bad])["cases"]
    assert (first.passed, second.passed) == (True, False)
    assert not study.has_passed([good, bad])


def test_page_says_what_passing_a_random_start_means() -> None:
    """Of case 2 the starts that came back are told by element; knots only where there are some."""
    measured = {
        "starts": 6,
        "ended_at_rest_P1": 3,
        "ended_at_rest_P2": 1,
        "ended_knotted_but_stationary": 2,
        "elements_whose_corners_are_inside_out_max": 5,
        "det_F_min_at_the_end": 0.9,
    }
    texts = [
        " ".join(HardCases().page([each], About("x"), []).split())
        for each in (
            result("2", **measured),
            result("2", **measured | {"ended_knotted_but_stationary": 0}),
        )
    ]
    assert "3 on linear tetrahedra and 1 on quadratic ones ended at rest" in texts[0]
    assert "The other 2 end in a knot: up to 5 elements" in texts[0]
    assert "knot:" not in texts[1]
