"""``calibrate material`` says what is told and what is not, and writes it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.cli.app import app
from tests.tacauchy_rig.app.calibration.material.made_up import SURE, made_presses, made_response

BALL = {"power": 1.5, "confined": 2.0}
GEL = {"young_pa": 5e5, "poisson": 0.465, "friction": 0.4}


@pytest.mark.parametrize("wrong", [False, True])
def test_one_ball_from_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, wrong: bool
) -> None:
    """Modulus and stated nu predict the forces; of wrong ones nothing is written."""
    monkeypatch.setattr(
        "tacauchy_rig.app.calibration.material.fit.respond", lambda *_, **__: made_response(**BALL)
    )
    candidates = ("sphere:diameter=6mm", "sphere:diameter=10mm")
    monkeypatch.setattr("tacauchy_rig.app.calibration.material.fit.CANDIDATES", candidates)
    presses = made_presses("sphere:diameter=6mm", **GEL, **BALL)
    force_n = presses.force_n.copy()
    force_n[4] *= 1.2 if wrong else 1.0
    table = tmp_path / "presses.csv"
    rows = zip(presses.depth_m, force_n, strict=True)
    lines = [f"sphere:diameter=6mm,{depth * 1e3},{force}" for depth, force in rows]
    table.write_text("\n".join(["indenter,depth_mm,force_n", *lines]) + "\n")
    out, found = tmp_path / "my.toml", tmp_path / "found.json"
    options = ["--out", str(out), "--json", str(found)]
    for override in SURE:
        options += ["--set", override]
    options += ["--sensor", "gelsight-mini", "--noise", "5mN"]
    result = CliRunner().invoke(app, ["calibrate", "material", str(table), *options])
    told = json.loads(found.read_text())
    assert told["told"]["poisson"]["low"] is None
    assert len(told["left_out"]) == 8
    assert "Poisson's ratio nu  not determined by these presses" in result.output
    assert result.exit_code == int(wrong), result.output
    assert out.exists() != wrong
    if wrong:
        assert "sphere:diameter=6mm at 0.5 mm: " in result.output
        return
    assert "next: sphere:diameter=10mm would leave" in result.output
    assert "next: sphere:diameter=6mm" not in result.output
    made = load_sensor(str(out))
    # At nu 0.48 in place of 0.465 the formula's ball is 3 % stiffer, so that E is as much smaller.
    assert made.material.young_pa == pytest.approx(5e5 * 0.97, rel=0.03)
    assert made.material.poisson == 0.48
