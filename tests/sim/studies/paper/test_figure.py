"""The page's figure, of made-up measurements."""

from __future__ import annotations

from pathlib import Path

from sim.studies.paper.comparison import draw_paper
from tests.sim.studies.paper.made_up import presses, report


def test_figure_is_drawn_with_and_without_reports(tmp_path: Path) -> None:
    """PDF and PNG, and a smaller PNG for the page; a report changes it."""
    pages = []
    for name, reports in (("bare", []), ("full", [report(emulated=True, ours=True)])):
        files = draw_paper(presses(), reports, tmp_path, page_folder=tmp_path / name)
        assert [file.suffix for file in files] == [".pdf", ".png", ".png"]
        pages.append(files[-1].read_bytes())
    assert pages[0] != pages[1]
