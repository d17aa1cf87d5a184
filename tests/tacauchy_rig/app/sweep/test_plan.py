"""Plans: the rows of each design, and what is refused before any work."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.sweep.plan import Row, read_plan, row_hash, rows_of
from tacauchy_rig.core.errors import ConfigError

_HEAD = 'design = "{design}"\n{count}\n[press]\nsensor = "gelsight-mini"\n'
_BALL = 'indenter = "sphere:diameter=6mm"\n'


def _rows(
    folder: Path, press: str, *, design: str = "sobol", count: str = "count = 8"
) -> list[Row]:
    file = folder / "plan.toml"
    file.write_text(_HEAD.format(design=design, count=count) + press)
    return list(rows_of(read_plan(file)))


def test_grids_combine_and_lists_go_side_by_side(tmp_path: Path) -> None:
    """Grids combine and lists go side by side."""
    press = _BALL + 'depth = ["0.3 mm", "0.6 mm"]\nx = ["-1 mm", "2 mm"]\n'
    grid = _rows(tmp_path, press, design="grid", count="")
    side = _rows(tmp_path, press, design="list", count="")
    assert [(row.x_m, row.depth_m) for row in grid] == [
        (x, depth) for x in (-1e-3, 2e-3) for depth in (0.3e-3, 0.6e-3)
    ]
    assert [(row.x_m, row.depth_m) for row in side] == [(-1e-3, 0.3e-3), (2e-3, 0.6e-3)]


@pytest.mark.parametrize("design", ["sobol", "latin-hypercube"])
def test_drawn_values_fill_their_range_evenly(tmp_path: Path, design: str) -> None:
    """Drawn values fill their range evenly."""
    press = (
        _BALL + 'depth = { from = "0.2 mm", to = "1 mm" }\nx = { from = "-4 mm", to = "4 mm" }\n'
    )
    rows = _rows(tmp_path, press, design=design)
    for values, low, high in (
        ([row.depth_m for row in rows], 0.2e-3, 1e-3),
        ([row.x_m for row in rows], -4e-3, 4e-3),
    ):
        eighths = np.floor((np.array(values, float) - low) / (high - low) * 8)
        assert sorted(eighths) == list(range(8))


def test_a_longer_sobol_plan_begins_with_the_presses_of_a_shorter_one(tmp_path: Path) -> None:
    """A longer sobol plan begins with the presses of a shorter one."""
    press = _BALL + 'depth = { from = "0.2 mm", to = "1 mm" }\nmaterial = "stated"\n'
    short = _rows(tmp_path, press, count="count = 5")
    long = _rows(tmp_path, press, count="count = 9")
    assert long[:5] == short
    assert np.std([row.material for row in long]) > 0.03  # the file states 11 %


def test_a_hash_follows_inputs_and_settings_but_not_the_size_of_shards(tmp_path: Path) -> None:
    """A hash follows inputs and settings but not the size of shards."""
    (row,) = _rows(tmp_path, _BALL + 'depth = "0.5 mm"\n', count="count = 1")
    plan = read_plan(tmp_path / "plan.toml").simulation
    name = row_hash(row, plan)
    assert row_hash(row, plan.model_copy(update={"shard": 7})) == name
    assert row_hash(row, plan.model_copy(update={"edge": 2e-3})) != name


@pytest.mark.parametrize(
    ("press", "count", "design", "message"),
    [
        ('depth = "0.5 mm"\nx = "14 mm"\n', "count = 1", "sobol", "beside the gel"),
        ('depth = "0.5 mm"\ndept = "1 mm"\n', "count = 1", "sobol", "dept: unknown key"),
        ('depth = "0.5 mm"\n', "count = 1000000000", "sobol", "count"),
        ('depth = "0.5 mm"\n', "count = 1\nseed = -1", "sobol", "seed"),
        ('depth = "4.1 mm"\n', "count = 1", "sobol", "in a gel of 4 mm"),
        ('depth = "0.5 mm"\nforce = "1 N"\n', "count = 1", "sobol", "a depth or a force"),
        ('depth = "0.5 mm"\n[dataset]\nname = "../up"\n', "count = 1", "sobol", "dataset.name"),
        ('depth = { from = "0.1 mm", to = "1 mm" }\n', "", "grid", "no steps"),
        ('depth = "0.5 mm"\nfriction = 3\n', "count = 1", "sobol", "friction = 3"),
        ('depth = "0.5"\n', "count = 1", "sobol", "has no unit"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, press: str, count: str, design: str, message: str
) -> None:
    """What cannot be is refused."""
    with pytest.raises(ConfigError, match=message) as refused:
        _rows(tmp_path, _BALL + press, design=design, count=count)
    assert refused.value.remedy


def test_a_grid_of_a_billion_presses_is_refused_before_it_is_made(tmp_path: Path) -> None:
    """A grid of a billion presses is refused before it is made."""
    steps = "".join(
        f'{name} = {{ from = "0.1 mm", to = "0.9 mm", steps = 1000 }}\n'
        for name in ("depth", "x", "y")
    )
    with pytest.raises(ConfigError, match="1,000,000,000 presses"):
        _rows(tmp_path, _BALL + steps, design="grid", count="")


def test_the_example_is_a_plan(tmp_path: Path) -> None:
    """The example is a plan."""
    text = resources.files("tacauchy_rig.app.sweep").joinpath("example.toml").read_text()
    (tmp_path / "plan.toml").write_text(text)
    rows = rows_of(read_plan(tmp_path / "plan.toml"))
    assert len(rows) == 500
    assert {row.object.partition(":")[0] for row in rows} == {"sphere", "cylinder"}
