"""What ``tacauchy-rig bench --part scenes`` asks for and writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.studies.bench.scenes import suite
from sim.studies.bench.scenes.catalogue import BenchScene
from sim.studies.bench.scenes.own_process import Order, SceneRow
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import ConfigError


def test_every_way_that_was_asked_for_is_pressed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two tolerances: both for each scene of the pattern, on page and in JSON; failures too."""
    asked: list[tuple[str, Order]] = []

    def failing(scene: BenchScene, orders: list[Order]) -> tuple[SceneRow, ...]:
        (order,) = orders
        asked.append((scene.name, order))
        row = SceneRow(
            scene=scene.name,
            tolerance=order.tolerance,
            device=order.device,
            environments=order.environments,
            press=None,
            failure="the press stopped at 0.1 mm",
        )
        return (row,)

    monkeypatch.setattr(suite, "pressed_together", failing)
    words = ["study", "bench", "--part", "scenes", "--only", "punch, t", "--out", str(tmp_path)]
    words += ["--tolerance", "5%", "--tolerance", "1%", "--limit", "7"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert [(name, order.tolerance) for name, order in asked] == [
        (name, tolerance)
        for name in ("punch, the paper's", "punch, twisted", "punch, tilted")
        for tolerance in ("5%", "1%")
    ]
    assert {order.limit_s for _, order in asked} == {7.0}
    page = (tmp_path / "scenes.md").read_text()
    assert page.count("| punch, tilted | the press stopped at 0.1 mm |") == 2
    groups = json.loads((tmp_path / "scenes.json").read_text())["groups"]
    assert [len(rows) for rows in groups] == [3, 3]
    assert not (tmp_path / "bench.md").exists()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--images"], "--environments"),
        (["--own-mesh"], "--environments"),
    ],
)
def test_options_that_do_not_fit_together_are_refused(
    tmp_path: Path, words: list[str], named: str
) -> None:
    """Before anything is pressed, with the remedy."""
    result = CliRunner().invoke(
        app, ["study", "bench", "--part", "scenes", "--out", str(tmp_path), *words]
    )
    assert isinstance(result.exception, ConfigError)
    assert named in str(result.exception)


def test_an_interruption_keeps_the_scenes_that_are_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of three scenes the second is stopped: one is on the page."""

    def stopping(scene: BenchScene, orders: list[Order]) -> tuple[SceneRow, ...]:
        if scene.name == "punch, twisted":
            raise KeyboardInterrupt
        row = SceneRow(
            scene=scene.name,
            tolerance=orders[0].tolerance,
            device=orders[0].device,
            environments=None,
            press=None,
            failure="stopped",
        )
        return (row,)

    monkeypatch.setattr(suite, "pressed_together", stopping)
    words = ["study", "bench", "--part", "scenes", "--only", "punch, t", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "interrupted: 1 of 3 scenes" in result.output
    assert "not all scenes" in " ".join((tmp_path / "scenes.md").read_text().split())
    (rows,) = json.loads((tmp_path / "scenes.json").read_text())["groups"]
    assert [row["scene"] for row in rows] == ["punch, the paper's"]
