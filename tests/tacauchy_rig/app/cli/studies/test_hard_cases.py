"""``tacauchy-rig study hard-cases``: one quick case, in a process of its own."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import ConfigError


def test_a_fast_case_is_printed_and_written(tmp_path: Path) -> None:
    """Case 14 alone, by its number: a table, a page and JSON, exit code 0."""
    numbers = tmp_path / "found.json"
    words = ["study", "hard-cases", "--only", "14", "--out", str(tmp_path), "--json", str(numbers)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "no contact: pass after" in done.stderr
    page = (tmp_path / "hard_cases.md").read_text()
    assert "**1 of 1 hard cases pass.**" in page
    (case,) = json.loads(numbers.read_text())["cases"]
    assert (case["number"], case["name"], case["passed"]) == (14, "no contact", True)
    assert case["measured"]["force_max_n"] == 0.0
    assert case["measured"]["iterations_before_touch"] == 0
    assert json.loads((tmp_path / "hard_cases.json").read_text())["cases"] == [case]


def test_cases_that_do_not_exist_are_refused() -> None:
    """Those that there are stand in the remedy."""
    done = CliRunner().invoke(app, ["study", "hard-cases", "--only", "99"])
    assert isinstance(done.exception, ConfigError)
    assert "no such hard case" in done.exception.message
