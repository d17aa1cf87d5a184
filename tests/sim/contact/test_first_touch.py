"""Where turned bodies first touch a domed gel."""

from __future__ import annotations

import numpy as np
import pytest

from sim.contact.first_touch import first_touch
from sim.scene.indenter import Cylinder, IndenterSet, Sphere, TurnedIndenter, tilted
from sim.sensor.sensor import load_sensor
from sim.studies.objects.shapes import chisel

BODIES = (Sphere(diameter_m=6e-3), Cylinder(diameter_m=5e-3, fillet_m=1e-3), chisel())


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.1, -0.15)])
def test_touch_is_where_no_point_of_the_underside_lies_deeper(tilt: tuple[float, float]) -> None:
    """Over a fine grid of the gel, the deepest point of the underside just touches."""
    pad, turn = load_sensor("gelsight-mini").pad, tilted(*tilt)
    places = np.array([[3e-3, -2e-3], [-6e-3, 4e-3], [0.0, 1e-3]])
    bodies = IndenterSet(bodies=BODIES, which=(0, 1, 2))
    found = first_touch(pad, bodies, places, np.array([turn] * 3))
    for (x, y), height, body in zip(places, found, BODIES, strict=True):
        near = np.linspace(-3e-3, 3e-3, 1201)
        u, v = np.meshgrid(near, near)
        beneath = TurnedIndenter(indenter=body, rotation=turn).lower_surface(u, v)
        deepest = (pad.height_at(x + u, y + v) - beneath).max()
        # Fillets are arcs here and chords there; grids miss a corner by some micrometres.
        assert height == pytest.approx(deepest, abs=5e-6)
