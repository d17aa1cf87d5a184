"""The figure of error against time."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from reports.figures.accuracy import CostPoint, Panel, bar_ends, draw_accuracy

_PANELS = (
    Panel(quantity="force", title="F_z"),
    Panel(quantity="depth", title="Depth"),
    Panel(quantity="image", title="Image"),
)
_POINTS = [
    CostPoint(
        time_s=1.0,
        errors={"force": -0.1, "depth": 0.2, "image": 0.0},
        on_front=True,
        is_linear_element=False,
        bars={"force": 0.02},
        label="fast",
    ),
    CostPoint(
        time_s=2.0,
        errors={"force": 0.5, "depth": 0.1},
        on_front=False,
        is_linear_element=True,
        bars={},
    ),
]


def test_figure_is_written_as_pdf_and_png(tmp_path: Path) -> None:
    """Both files, the picture wide enough to print, with something on it."""
    files = draw_accuracy(_POINTS, {"force": 0.01}, _PANELS, folder=tmp_path / "new")
    assert [file.name for file in files] == ["accuracy.pdf", "accuracy.png"]
    picture = cv2.imread(str(files[1]))
    assert picture is not None
    assert picture.shape[1] > 2000
    assert picture.std() > 5.0


@pytest.mark.parametrize(("size", "bar"), [(0.1, 0.01), (0.01, 0.1)])
def test_error_bars_stay_on_a_logarithmic_axis(size: float, bar: float) -> None:
    """A bar larger than the error ends above zero."""
    down, up = bar_ends(size, bar)
    assert 0.0 < size - down <= size
    assert up == bar
