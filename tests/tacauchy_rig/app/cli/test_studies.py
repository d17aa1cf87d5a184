"""``tacauchy-rig study``: what its commands list, refuse, measure and write."""

from __future__ import annotations

import json
import shlex
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.press import press
from sim.press_command import scene_from
from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.studies.verification import forces
from sim.studies.verification.forces import disc_press
from tacauchy_rig.app.cli.app import app


def test_only_round_bodies_are_moved() -> None:
    """A plane has no axis to turn about."""
    done = CliRunner().invoke(app, ["study", "modes", "--indenter", "plane"])
    assert done.exit_code != 0
    assert "only round bodies" in str(done.exception)


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


def test_one_section_is_shown_written_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With two coarse presses: table, page with title and command, JSON, progress on stderr."""
    allowed = ((0.45, 0.2), (0.47, 0.2))
    coarse = partial(forces.measure_punch, preset=Preset.FAST, allowed=allowed)
    monkeypatch.setattr(forces, "measure_punch", coarse)
    page, numbers = tmp_path / "page.md", tmp_path / "numbers.json"
    words = ["study", "verify", "--only", "punch", "--out", str(page), "--json", str(numbers)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "kappa" in done.stdout
    assert "punch: met" in done.stderr
    text = page.read_text("utf-8")
    assert text.startswith("# Flat punch on a bonded layer")
    assert f"study verify --only punch --out {page}`" in " ".join(text.split())
    found = json.loads(numbers.read_text("utf-8"))
    assert [row[0] for row in found["sections"]["punch"]["rows"]] == [0.45, 0.47]
    assert "warp-lang" in found["versions"]
    again = CliRunner().invoke(app, [*words, "--resume", str(numbers)])
    assert "kappa" in again.stdout
    assert "punch" not in again.stderr


def test_the_pages_command_gives_the_pages_number(tmp_path: Path) -> None:
    """A scene pressed by its command and by the simulator give the same force."""
    words = disc_press(LawName.NEO_HOOKEAN, 0.05e-3, Preset.FAST)
    numbers = tmp_path / "press.json"
    done = CliRunner().invoke(app, ["press", *shlex.split(words), "--json", str(numbers)])
    assert done.exit_code == 0
    force = json.loads(numbers.read_text("utf-8"))["force_n"][2]
    assert force == pytest.approx(press(scene_from(words)).force_n[2], rel=1e-8)
