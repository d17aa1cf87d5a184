"""``study effects``: its scenes, its refusals, and the page that it writes."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app


def test_scenes_are_listed_without_pressing() -> None:
    """``--list`` names every scene."""
    done = CliRunner().invoke(app, ["study", "effects", "--list"])
    assert done.exit_code == 0
    assert "slow and lossy" in done.stdout


def test_a_scene_is_checked_and_written_down(tmp_path: Path) -> None:
    """One scene: a line, a row of the page, and JSON."""
    page, found = tmp_path / "effects.md", tmp_path / "effects.json"
    files = ("--out", str(page), "--json", str(found))
    done = CliRunner().invoke(app, ["study", "effects", "--only", "by force", *files])
    assert done.exit_code == 0, done.output
    assert "times the time with" in done.stderr
    text = page.read_text(encoding="utf-8")
    assert "All outputs were kept in 1 of 1 scenes" in text
    assert "| by force | inertia, gravity | " in text
    (scene,) = json.loads(found.read_text(encoding="utf-8"))["scenes"]
    assert scene["passed"] is True
    assert "gravity" in scene["added"]
    assert scene["differences"]["depth"] <= scene["tolerances"]["depth"]


def test_scenes_are_drawn_with_a_seed() -> None:
    """``--random`` and ``--seed`` name other scenes; nothing is pressed for a list."""
    listed = [
        CliRunner()
        .invoke(app, ["study", "effects", "--list", "--random", "3", "--seed", seed])
        .stdout
        for seed in ("1", "2", "1")
    ]
    assert listed[0] == listed[2] != listed[1]
    assert len(listed[0].splitlines()) == 3


def test_a_scene_that_takes_too_long_is_left_and_named(tmp_path: Path) -> None:
    """Nothing is lost in silence; it is no miss."""
    found = tmp_path / "found.json"
    limited = ["study", "effects", "--only", "by force", "--limit", "1 ms", "--json", str(found)]
    done = CliRunner().invoke(app, limited)
    assert done.exit_code == 0
    assert "not done after 0.001 s" in done.stderr
    assert list(json.loads(found.read_text("utf-8"))["not_pressed"]) == ["by force"]


def test_an_unknown_scene_is_refused() -> None:
    """The message offers those that there are."""
    done = CliRunner().invoke(app, ["study", "effects", "--only", "nothing"])
    assert done.exit_code != 0
    assert "--only 'nothing': no such scene" in str(done.exception)


def test_drawn_scenes_can_be_taken_one_by_one() -> None:
    """So that many may be parted over machines; a number beyond the last is refused."""
    drawn = ["study", "effects", "--random", "9", "--seed", "1", "--list"]
    whole, one = (
        CliRunner().invoke(app, [*drawn, *only]).stdout.splitlines()
        for only in ([], ["--only", "4"])
    )
    assert one == [whole[4]]
    beyond = CliRunner().invoke(app, [*drawn, "--only", "9"])
    assert "--only '9': no such scene" in str(beyond.exception)


def test_what_was_found_before_is_not_pressed_again(tmp_path: Path) -> None:
    """A run that was cut, or parted over machines, goes on; another seed's file is refused."""
    first, page, both = (tmp_path / name for name in ("a.json", "all.md", "both.json"))
    drawn = ["study", "effects", "--random", "40", "--only", "37"]
    CliRunner().invoke(app, [*drawn, "--seed", "1", "--json", str(first)])
    again = [*drawn, "--resume", str(first), "--out", str(page), "--json", str(both)]
    done = CliRunner().invoke(app, [*again, "--seed", "1", "--limit", "1 ms"])
    assert done.exit_code == 0, done.output
    assert "All outputs were kept in 1 of 1 scenes" in page.read_text(encoding="utf-8")
    assert (
        json.loads(both.read_text("utf-8"))["scenes"]
        == json.loads(first.read_text("utf-8"))["scenes"]
    )
    other = CliRunner().invoke(app, [*again, "--seed", "2"])
    assert "37 is something else there" in str(other.exception)
    page.write_text("{}", encoding="utf-8")
    broken = CliRunner().invoke(app, [*drawn, "--seed", "1", "--resume", str(page)])
    assert f"--resume {page}" in str(broken.exception)
