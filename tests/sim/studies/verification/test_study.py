"""The study as a whole, and what F_z must hardly depend on."""

from dataclasses import replace

import pytest

from sim.replay import replay_forces, replay_scene
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Drive, Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.verification.balance import barrier_row, limit_without_distance, shift_row

SCENE = Scene(
    pad=DiscPad(radius_m=5e-3, height_m=3e-3),
    material=Material(young_pa=3e5, poisson=0.46),
    indenter=Sphere(diameter_m=5e-3),
    target=Target(depth_m=0.05e-3),
    preset=Preset.FAST,
)


def test_parabola_through_three_distances() -> None:
    """Forces a + b d + c d^2 have the limit a."""
    forces = tuple(2.0 + 0.3 * d + 0.1 * d**2 for d in (1.0, 0.5, 0.25))
    assert limit_without_distance(*forces) == pytest.approx(2.0)


def test_contact_distance_hardly_matters() -> None:
    """F_z of a small press is within 0.3 % of its limit."""
    assert float(barrier_row(SCENE)["difference"] or 0.0) < 3e-3


def test_shifted_press_moves_by_half_an_edge() -> None:
    """A ball half an element aside on the same mesh is felt a little, not a lot."""
    assert 0.0 < float(shift_row(SCENE)["change"] or 0.0) < 0.05


@pytest.mark.slow
def test_sharp_rim_shifted() -> None:
    """A sharp punch cuts other faces when it is moved; F_z stays within 6 % on preset fast."""
    found = shift_row(replace(SCENE, indenter=Cylinder(diameter_m=3e-3)))
    assert 0.0 < float(found["change"] or 0.0) < 0.06


def test_drives_agree_in_depth() -> None:
    """One small force, by load and by displacement."""
    sensor, punch = load_sensor("gelsight-mini"), Cylinder(diameter_m=5e-3, fillet_m=0.1e-3)
    scene = replay_scene(sensor, punch, (0.6,), preset=Preset.FAST, tolerance_n=0.01)
    load, search = (
        replay_forces(replace(scene, drive=drive), (0.6,))[0].trials[0]
        for drive in (Drive.LOAD, Drive.SEARCH)
    )
    assert search.depth_simulated_m == pytest.approx(load.depth_simulated_m, rel=1e-3)
