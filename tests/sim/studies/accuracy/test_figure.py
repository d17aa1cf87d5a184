"""The figure of error against time."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from sim.mesh.elements import ElementOrder
from sim.scene.scene import Preset
from sim.studies.accuracy.figure import bar_ends, draw_rows
from sim.studies.accuracy.judging import QUANTITIES
from sim.studies.accuracy.press import Configuration, Row


def _row(name: str, element: ElementOrder, error: float, *, on_front: bool) -> Row:
    return Row(
        configuration=Configuration(name=name, preset=Preset.FAST, element=element),
        errors=dict.fromkeys(QUANTITIES, error),
        chances=dict.fromkeys(QUANTITIES, 0.01),
        setup_s=1.0,
        solve_s=1.0,
        cpu_s=2.0 - error,
        on_front=on_front,
    )


def test_figure_is_written_as_pdf_and_png(tmp_path: Path) -> None:
    """Both files, the picture wide enough to print, with something on it."""
    rows = (
        _row("fast", ElementOrder.P2, -0.1, on_front=True),
        _row("P1, d_hat 1 mm", ElementOrder.P1, 0.5, on_front=False),
        _row("exact", ElementOrder.P2, 0.0, on_front=True),
    )
    files = draw_rows(rows, dict.fromkeys(QUANTITIES, 0.01), tmp_path / "new")
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
