"""``tacauchy-rig verify``."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.press import press
from sim.press_command import scene_from
from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.studies.verification import catalogue
from sim.studies.verification.disc import disc_press
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import ConfigError, ConvergenceError
from tacauchy_rig.core.tables import Table


def test_one_section_is_shown_written_and_kept(tmp_path: Path) -> None:
    """The quickest section: table, page with its own command, JSON, progress on stderr."""
    page, numbers = tmp_path / "page.md", tmp_path / "numbers.json"
    done = CliRunner().invoke(
        app,
        ["study", "verify", "--sections", "mesh-table", "--out", str(page), "--json", str(numbers)],
    )
    assert done.exit_code == 0
    assert "tetrahedra, refined" in done.stdout
    assert "mesh-table: reported" in done.stderr
    assert f"`tacauchy-rig verify --sections mesh-table --out {page}`" in " ".join(
        page.read_text("utf-8").split()
    )
    found = json.loads(numbers.read_text("utf-8"))
    assert found["sections"]["mesh-table"]["rows"][1][:2] == ["tetrahedra, refined", 1920]
    assert "warp-lang" in found["versions"]


def test_what_takes_hours_is_measured_on_request_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """By default every other section is measured."""
    met = Table(title="t", columns=("a",), rows=((1.5,),), criterion="c", passed=True)
    measured: list[str] = []
    for name in catalogue.SECTIONS:

        def measure(name: str = name) -> Table:
            measured.append(name)
            return met

        monkeypatch.setitem(catalogue.SECTIONS, name, measure)
    assert CliRunner().invoke(app, ["study", "verify"]).exit_code == 0
    assert set(measured) == set(catalogue.SECTIONS) - catalogue.ON_REQUEST
    assert set(catalogue.SECTIONS) > catalogue.ON_REQUEST


def test_a_missed_criterion_exits_with_1(monkeypatch: pytest.MonkeyPatch) -> None:
    """And is named on the last line."""
    missed = Table(title="t", columns=("a",), rows=((1.5,),), criterion="c", passed=False)
    monkeypatch.setitem(catalogue.SECTIONS, "punch", lambda: missed)
    done = CliRunner().invoke(app, ["study", "verify", "--sections", "punch"])
    assert done.exit_code == 1
    assert done.stdout.endswith("missed: punch\n")


def test_a_press_that_fails_is_its_sections_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other sections are still measured."""

    def fails() -> Table:
        raise ConvergenceError("the press stopped at 0.1 mm", remedy="none")

    monkeypatch.setitem(catalogue.SECTIONS, "punch", fails)
    done = CliRunner().invoke(app, ["study", "verify", "--sections", "punch,mesh-table"])
    assert done.exit_code == 1
    assert "tetrahedra, refined" in done.stdout


def test_an_aborted_run_leaves_the_page_of_what_was_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the command that makes just that."""

    def aborts() -> Table:
        raise KeyboardInterrupt

    met = Table(title="Punch", columns=("a",), rows=((1.5,),), criterion="c", passed=True)
    monkeypatch.setitem(catalogue.SECTIONS, "punch", lambda: met)
    monkeypatch.setitem(catalogue.SECTIONS, "disc", aborts)
    page = tmp_path / "page.md"
    CliRunner().invoke(app, ["study", "verify", "--out", str(page)])
    text = " ".join(page.read_text("utf-8").split())
    assert "## Punch" in text
    assert f"`tacauchy-rig verify --sections punch --out {page}`" in text


def test_an_unknown_section_is_refused_with_the_known_ones() -> None:
    """Before anything is pressed."""
    done = CliRunner().invoke(app, ["study", "verify", "--sections", "pinch"])
    assert isinstance(done.exception, ConfigError)
    assert "punch, disc" in (done.exception.remedy or "")


def test_the_pages_command_gives_the_pages_number(tmp_path: Path) -> None:
    """A scene pressed by its command and by the simulator give the same force."""
    words = disc_press(LawName.NEO_HOOKEAN, 0.05e-3, Preset.FAST)
    numbers = tmp_path / "press.json"
    done = CliRunner().invoke(app, ["press", *shlex.split(words), "--json", str(numbers)])
    assert done.exit_code == 0
    force = json.loads(numbers.read_text("utf-8"))["force_n"][2]
    assert force == pytest.approx(press(scene_from(words)).force_n[2], rel=1e-8)
