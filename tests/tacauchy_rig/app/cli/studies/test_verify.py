"""``tacauchy-rig study verify``."""

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


def test_a_section_of_a_page_of_its_own_is_measured_on_request_only() -> None:
    """It is listed, as all are."""
    done = CliRunner().invoke(app, ["study", "verify", "--list"])
    assert "height-map" in done.stdout


def test_the_pages_command_gives_the_pages_number(tmp_path: Path) -> None:
    """A scene pressed by its command and by the simulator give the same force."""
    words = disc_press(LawName.NEO_HOOKEAN, 0.05e-3, Preset.FAST)
    numbers = tmp_path / "press.json"
    done = CliRunner().invoke(app, ["press", *shlex.split(words), "--json", str(numbers)])
    assert done.exit_code == 0
    force = json.loads(numbers.read_text("utf-8"))["force_n"][2]
    assert force == pytest.approx(press(scene_from(words)).force_n[2], rel=1e-8)
