"""Height maps of two meshes side by side."""

from __future__ import annotations

from sim.indenter import Sphere
from sim.scene import Preset
from sim.sensor import load_sensor
from sim.verification.height_map import LIMIT_M, height_map_error


def test_two_meshes_show_nearly_one_surface_below_the_ball() -> None:
    """Fast against balanced: most of the image within the limit, no pixel above the ball."""
    found = height_map_error(
        "ball",
        Sphere(diameter_m=8e-3),
        preset=Preset.FAST,
        sensor=load_sensor("gelsight-mini"),
        finer=Preset.BALANCED,
    )
    assert found.pixels_above == 0
    assert 0.0 < found.rms_m < LIMIT_M
    assert found.largest_m < 6.0 * LIMIT_M
