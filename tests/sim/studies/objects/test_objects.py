"""Objects of triangles: their shapes and figure."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.studies.objects.shapes import OBJECTS
from sim.studies.objects.study import draw_objects
from tests.sim.made_up_presses import object_presses

SIZES_MM = {
    "bar": (8.0, 1.5, 4.0),
    "hexagon": (4.0, 4.619, 4.0),
    "cross": (5.0, 5.0, 4.0),
    "ring": (5.6, 5.6, 1.2),
    "ellipsoid": (6.0, 3.6, 4.0),
}


@pytest.mark.parametrize("name", list(OBJECTS))
def test_objects_have_their_sizes(name: str) -> None:
    """Each is closed (or it would be refused) and as large as its docstring says."""
    assert OBJECTS[name]().size_m * 1e3 == pytest.approx(SIZES_MM[name], abs=2e-3)


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("bar", (3.9e-3, 0.7e-3), (0.0, 0.8e-3)),
        ("hexagon", (1.9e-3, 0.0), (2.1e-3, 0.0)),
        ("cross", (2.4e-3, 0.0), (1.0e-3, 1.0e-3)),
        ("ring", (2.2e-3, 0.0), (0.0, 0.0)),
        ("ellipsoid", (0.0, 0.0), (3.1e-3, 0.0)),
    ],
)
def test_objects_touch_where_they_should(
    name: str, inside: tuple[float, float], outside: tuple[float, float]
) -> None:
    """Their lowest part is at the tip's height; beside it there is nothing, or a hole."""
    x, y = np.array([[inside[0], outside[0]], [inside[1], outside[1]]])
    height = OBJECTS[name]().lower_surface(x, y)
    assert height[0] == pytest.approx(0.0, abs=2e-6)
    assert height[1] == np.inf


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
