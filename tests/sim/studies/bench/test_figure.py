"""The benchmark's figure."""

from __future__ import annotations

from pathlib import Path

import cv2

from sim.studies.bench.figure import draw_bench
from sim.studies.bench.growth import GrowthRow
from sim.studies.bench.suite import Benchmark

_GROWTH = tuple(
    GrowthRow(
        refinement=1.0,
        tet_count=size,
        node_count=2 * size,
        newton_iterations=10,
        wall_s=cpu_s,
        cpu_s=cpu_s,
    )
    for size, cpu_s in ((300, 1.0), (1000, 2.5), (3000, 12.0))
)


def test_figure_is_written_as_pdf_and_png(tmp_path: Path) -> None:
    """Both files, wide enough to print, with something on them."""
    files = draw_bench(Benchmark(growth=_GROWTH), folder=tmp_path)
    assert [file.name for file in files] == ["bench.pdf", "bench.png"]
    picture = cv2.imread(str(files[1]))
    assert picture is not None
    assert picture.shape[1] > 1200
    assert picture.std() > 5.0


def test_what_has_no_figure_draws_none(tmp_path: Path) -> None:
    """Without growth there is nothing to see, and no file."""
    assert draw_bench(Benchmark(), folder=tmp_path) == []
    assert not list(tmp_path.iterdir())
