"""The benchmark's figure."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from reports.figures.bench import Growth, draw_bench


@pytest.mark.parametrize("batches", [[], [(1, 20.0), (8, 150.0)]], ids=["alone", "batches"])
def test_figure_is_written_as_pdf_and_png(batches: list[tuple[int, float]], tmp_path: Path) -> None:
    """Both files, wide enough to print, with something on them."""
    growth = Growth(
        sizes=[300.0, 1000.0, 3000.0], times_s=[1.0, 2.5, 12.0], exponent=1.1, limit=1.5
    )
    parts = {"fast": {"assembly": 3.0, "contact": 0.5}, "balanced": {"assembly": 9.0, "contact": 1}}
    files = draw_bench(parts, growth, batches, folder=tmp_path)
    assert [file.name for file in files] == ["bench.pdf", "bench.png"]
    picture = cv2.imread(str(files[1]))
    assert picture is not None
    assert picture.shape[1] > 2000
    assert picture.std() > 5.0
