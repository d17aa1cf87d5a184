"""The page of five objects, of made-up presses."""

from __future__ import annotations

from dataclasses import replace

from sim.scene.scene import Preset
from sim.studies.objects.shapes import OBJECTS
from sim.studies.objects.study import Objects
from tacauchy_rig.core.study import About, Result
from tests.sim.made_up_presses import object_presses


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
