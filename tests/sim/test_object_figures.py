"""The figure and the page of five objects, of made-up presses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from sim.object_figures import draw_objects
from sim.object_runs import ObjectPress
from sim.object_shapes import OBJECTS
from sim.optics.height_map import HeightMaps
from sim.scene import Preset
from tacauchy_rig.cli.objects_page import markdown
from tests.sim.optics.analytic_surface import APEX_M, camera


def _presses(sensor: str) -> list[ObjectPress]:
    """Return every object, its dent and image that of a ring."""
    x, y = camera().pad_grid()
    dent = 4e-4 * np.exp(-(((np.hypot(x, y) - 2e-3) / 5e-4) ** 2))
    maps = HeightMaps(loaded=APEX_M - dent, rest=np.full_like(dent, APEX_M), contact=dent > 3.9e-4)
    return [
        ObjectPress(
            name=name,
            sensor=sensor,
            force_n=1.5,
            maps=maps,
            surface=make().surface,
            image=np.full((*x.shape, 3), 118, np.uint8),
            geometry=camera(),
            highest_over_m=0.0,
            processor_s=30.0,
        )
        for name, make in OBJECTS.items()
    ]


def test_figure_has_all_files_and_all_bodies(tmp_path: Path) -> None:
    """PDF, PNG and the page's PNG are written, and no body's panel is empty."""
    runs = [_presses("one"), _presses("another")]
    files = draw_objects(runs, tmp_path / "out", page_folder=tmp_path / "images")
    assert [file.name for file in files] == ["five_objects.pdf", *["five_objects.png"] * 2]
    picture = cv2.imread(str(files[1]), cv2.IMREAD_GRAYSCALE)
    top = picture[: picture.shape[0] // 5, picture.shape[1] // 10 : -picture.shape[1] // 10]
    for panel in np.array_split(top, len(OBJECTS), axis=1):
        assert np.mean((panel > 90) & (panel < 250)) > 0.01


def test_page_names_every_press_and_what_is_above_an_object() -> None:
    """One row a press; a pixel above its object is told in micrometres."""
    first, *others = _presses("one")
    text = markdown(
        [[replace(first, highest_over_m=2e-6), *others]], command="x", preset=Preset.FAST
    )
    assert "Made by `x`." in text
    rows = [line for line in text.splitlines() if line.startswith("| one |")]
    assert len(rows) == len(OBJECTS)
    assert rows[0] == "| one | bar | 1.500 | 2 | 30 |"
    assert rows[1] == "| one | hexagon | 1.500 | 0 | 30 |"
