"""Tables of images and numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.optics.calibrate.ball_press import read_image_table
from tacauchy_rig.core.errors import ConfigError


def test_columns_stand_in_any_order(tmp_path: Path) -> None:
    """A line gives its place, its image and the numbers that are asked for, and no others."""
    table = tmp_path / "table.csv"
    table.write_text("y,note,image,x\n2,new,a.png,1.5\n-1,,b.png,3\n", encoding="utf-8")
    lines = read_image_table(table, what="table", numbers=("x", "y"))
    assert lines == [
        (f"{table}, line 2", "a.png", [1.5, 2.0]),
        (f"{table}, line 3", "b.png", [3.0, -1.0]),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image,x\n", "lacks the column y"),
        ("image,x,y\n,1,2\n", "line 2: names no image"),
        ("image,x,y\na.png,1,two\n", "line 2: y: .*two"),
        ("image,x,y\na.png,1\n", "line 2: y"),
        ("image,x,y\na.png,nan,2\n", "line 2: x is nan"),
    ],
)
def test_what_is_missing_or_no_number_is_named(tmp_path: Path, text: str, message: str) -> None:
    """The message names the line and the column."""
    table = tmp_path / "table.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_image_table(table, what="table", numbers=("x", "y"))
