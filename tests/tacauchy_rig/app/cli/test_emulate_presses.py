"""``tacauchy-rig emulate presses``."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app


def _run(*words: object) -> str:
    result = CliRunner().invoke(app, ["emulate", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_presses_without_noise_say_what_the_noise_is(tmp_path: Path) -> None:
    """Images are numbered from --first on; the JSON has the noise that was left out."""
    shown = _run(
        *("presses", "--out", tmp_path / "check", "--count", 5, "--first", 41, "--noise-free"),
        *("--json", tmp_path / "check.json"),
    )
    assert "5 presses of a 4.70 mm ball on an emulated GelSight Mini" in shown
    assert "--scale 15.77,15.77px/mm" in shown
    names = sorted(path.name for path in (tmp_path / "check").glob("press-*.png"))
    assert names == [f"press-{number}.png" for number in range(41, 46)]
    found = json.loads((tmp_path / "check.json").read_text())
    assert found["first"] == 41
    assert 0.0 < found["left_out"]["noise"] < found["left_out"]["recorded"]
    assert f"{found['left_out']['noise']:.2f} grey levels" in shown


def test_recorded_presses_leave_nothing_out(tmp_path: Path) -> None:
    """With noise there is nothing to say of it."""
    shown = _run("presses", "--out", tmp_path / "presses", "--count", 5)
    assert "left out" not in shown
    assert (tmp_path / "presses" / "circles.csv").read_text().count("press-") == 5
