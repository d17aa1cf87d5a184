"""``effects-check``: its scenes, its refusals, and the page that it writes."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from tacauchy_rig.cli.app import app


def test_scenes_are_listed_without_pressing() -> None:
    """``--list`` names every scene."""
    done = CliRunner().invoke(app, ["effects-check", "--list"])
    assert done.exit_code == 0
    assert "slow and lossy" in done.stdout


def test_a_scene_is_checked_and_written_down(tmp_path: Path) -> None:
    """One scene: a line, a row of the page, and JSON."""
    page, found = tmp_path / "effects.md", tmp_path / "effects.json"
    files = ("--out", str(page), "--json", str(found))
    done = CliRunner().invoke(
        app, ["effects-check", "--only", "by force", "--no-one-by-one", *files]
    )
    assert done.exit_code == 0, done.output
    assert "times the time with" in done.stdout
    text = page.read_text(encoding="utf-8")
    assert "| by force | 2 % | " in text
    assert "1 of " in text
    assert "inertia is off in both presses of by force" in text
    (scene,) = json.loads(found.read_text(encoding="utf-8"))["scenes"]
    assert scene["passed"] is True
    assert "gravity" in scene["added"]
    assert scene["difference"] <= scene["tolerance"]


def test_an_unknown_scene_is_refused() -> None:
    """The message offers those that there are."""
    done = CliRunner().invoke(app, ["effects-check", "--only", "nothing"])
    assert done.exit_code != 0
    assert "no scene is called 'nothing'" in str(done.exception)
