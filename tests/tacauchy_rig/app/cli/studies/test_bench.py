"""What ``tacauchy-rig bench`` writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.studies.bench import suite
from sim.studies.bench.growth import GrowthRow
from sim.studies.bench.suite import Benchmark
from tacauchy_rig.app.cli.app import app


@pytest.mark.parametrize("grown", [False, True])
def test_a_page_shows_the_figure_that_was_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, grown: bool
) -> None:
    """Where no part that was measured has one, the page has none either."""
    rows = tuple(
        GrowthRow(
            refinement=size / 100.0,
            tet_count=size,
            node_count=2 * size,
            newton_iterations=10,
            wall_s=size / 50.0,
            cpu_s=size / 50.0,
        )
        for size in (100, 200, 400)
    )
    found = Benchmark(growth=rows if grown else (), absent=("a peer",))
    monkeypatch.setattr(suite, "run_bench", lambda *_args, **_kwargs: found)
    result = CliRunner().invoke(app, ["study", "bench", "--part", "growth", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert "not measured: a peer" in result.output
    assert (tmp_path / "bench.png").exists() == grown
    assert ("bench.png" in (tmp_path / "bench.md").read_text()) == grown
    assert len(json.loads((tmp_path / "bench.json").read_text())["growth"]) == len(found.growth)
