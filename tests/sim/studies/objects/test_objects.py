"""Objects of triangles: their shapes and figure."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib import rc_context

from sim.scene.objects import OBJECTS
from sim.scene.scene import Preset
from sim.studies.objects.study import Objects, objects_figure
from tacauchy_rig.core.plot_style import FRAMED_STYLE, PRINT_DPI
from tacauchy_rig.core.study import About, Result
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
def test_a_figure_has_all_bodies(tmp_path: Path) -> None:
    """No body's panel is empty."""
    runs = [object_presses("one"), object_presses("another")]
    with rc_context(FRAMED_STYLE):
        objects_figure(runs).savefig(tmp_path / "objects.png", dpi=PRINT_DPI)
    picture = cv2.imread(str(tmp_path / "objects.png"), cv2.IMREAD_GRAYSCALE)
    top = picture[: picture.shape[0] // 5, picture.shape[1] // 10 : -picture.shape[1] // 10]
    for panel in np.array_split(top, len(OBJECTS), axis=1):
        assert np.mean((panel > 90) & (panel < 250)) > 0.01


def test_page_names_every_press_and_what_is_above_an_object() -> None:
    """One row a press; a pixel above its object is told in micrometres."""
    first, *others = object_presses("one")
    presses = [replace(first, highest_over_m=2e-6), *others]
    results = [Result(name=press.name, found=press) for press in presses]
    text = Objects("digit", Preset.FAST).page(results, About("x"), [])
    assert "Made by `x`." in text
    rows = [line for line in text.splitlines() if line.startswith("| one |")]
    assert len(rows) == len(OBJECTS)
    assert rows[0] == "| one | bar | 1.5 | 2 | 30 |"
    assert rows[1] == "| one | hexagon | 1.5 | 0 | 30 |"
