"""``torture``: rows that pass, raise and hang, and what is printed and written of them."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.studies.hard_cases import catalogue
from sim.studies.hard_cases.case import CaseResult, HardCase
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.studies import torture
from tacauchy_rig.core.errors import ConfigError

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

ROWS = """
import time
from tacauchy_rig.core.errors import ConvergenceError

def raises():
    raise ConvergenceError("the press stopped at 3.1 mm")

def hangs():
    time.sleep(600)
"""


def test_a_fast_row_is_printed_and_written(tmp_path: Path) -> None:
    """Row 14 alone: a table, a page and JSON, exit code 0."""
    page, numbers = tmp_path / "page.md", tmp_path / "found.json"
    done = CliRunner().invoke(
        app, ["study", "hard-cases", "--rows", "14", "--out", str(page), "--json", str(numbers)]
    )
    assert done.exit_code == 0
    assert "1 of 1 hard cases pass." in done.stdout
    assert "14 no contact" in done.stderr
    assert "Written by `tacauchy-rig torture --rows 14`" in page.read_text()
    case = json.loads(numbers.read_text())["cases"][0]
    assert case["measured"]["force_max_n"] == 0.0
    assert case["measured"]["iterations_before_touch"] == 0


def test_rows_that_fail_do_not_take_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One raises, one hangs: both are rows of the table, and the exit code is 1."""
    (tmp_path / "failing_rows.py").write_text(ROWS)
    monkeypatch.syspath_prepend(tmp_path)
    rows = importlib.import_module("failing_rows")
    cases = (
        HardCase(number=1, name="first", criterion="ends", measure=rows.raises, limit_s=60.0),
        HardCase(number=2, name="second", criterion="ends", measure=rows.hangs, limit_s=5.0),
    )
    monkeypatch.setattr(catalogue, "select_cases", lambda _: cases)
    page = tmp_path / "page.md"
    done = CliRunner().invoke(app, ["study", "hard-cases", "--out", str(page)])
    assert done.exit_code == 1
    assert "0 of 2 hard cases pass; failed: 1, 2." in done.stdout
    assert "No numbers: ConvergenceError: the press stopped at 3.1 mm" in page.read_text()
    assert "No numbers: not done after 5 s" in page.read_text()


@pytest.mark.parametrize("rows", ["x", "1;4", "99"])
def test_rows_that_do_not_exist_are_refused(rows: str) -> None:
    """Neither words nor unknown numbers start anything."""
    done = CliRunner().invoke(app, ["study", "hard-cases", "--rows", rows])
    assert isinstance(done.exception, ConfigError)
    assert "--rows" in str(done.exception)


def test_page_has_criterion_numbers_verdict_and_command() -> None:
    """What was asked, what came out, and what made it."""
    page = torture.markdown([GOOD, BAD], command="tacauchy-rig torture", used={"numpy": "2.1"})
    assert "**1 of 2 hard cases pass; failed: 4.**" in page
    assert "Written by `tacauchy-rig torture` with numpy 2.1" in page
    assert "2 of the 19 cases are on this page" in page
    assert "| 1 | flat start | pass | 2 |" in page
    assert "| distance_over_H | 3.25e-13 |" in page
    assert "| same | yes |" in page
    assert "## 4. 80 %: FAIL" in page
    assert "No numbers: stopped at 3.1 mm" in page


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
    case = CaseResult(number=2, name="random", criterion="x", passed=True, measured=measured)
    untied = replace(case, measured=measured | {"ended_knotted_but_stationary": 0})
    texts = [
        " ".join(torture.markdown([each], command="x", used={}).split()) for each in (case, untied)
    ]
    assert "3 on linear tetrahedra and 1 on quadratic ones ended at rest" in texts[0]
    assert "The other 2 end in a knot: up to 5 elements" in texts[0]
    assert "knot:" not in texts[1]
