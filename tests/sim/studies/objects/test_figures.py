"""The figure of five objects, of made-up presses."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.studies.objects.figures import draw_objects
from sim.studies.objects.shapes import OBJECTS
from tests.sim.made_up_presses import object_presses


@pytest.mark.slow
def test_figure_has_all_files_and_all_bodies(tmp_path: Path) -> None:
    """PDF, PNG and the page's PNG are written, and no body's panel is empty."""
    runs = [object_presses("one"), object_presses("another")]
    files = draw_objects(runs, tmp_path / "out", page_folder=tmp_path / "images")
    assert [file.name for file in files] == ["five_objects.pdf", *["five_objects.png"] * 2]
    picture = cv2.imread(str(files[1]), cv2.IMREAD_GRAYSCALE)
    top = picture[: picture.shape[0] // 5, picture.shape[1] // 10 : -picture.shape[1] // 10]
    for panel in np.array_split(top, len(OBJECTS), axis=1):
        assert np.mean((panel > 90) & (panel < 250)) > 0.01
