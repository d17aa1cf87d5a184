"""Coarse presses with a tilted indenter."""

import math
from pathlib import Path

import numpy as np
import pytest

from sim.replay import replay_scene
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.scene import Output, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.tilt_sensitivity import can_tilt, kept_forces, press_tilted, restoring_moments, tilt_costs
from tacauchy_rig.core.arrays import FloatArray

RADIUS_M = 2.5e-3


def _scene(sensor: str) -> Scene:
    """Return the rig's punch with friction, to 3 N."""
    punch = Cylinder(diameter_m=2.0 * RADIUS_M, fillet_m=1e-4)
    return replay_scene(load_sensor(sensor), punch, [3.0], friction=0.5)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The punch on a GelSight Mini."""
    return _scene("gelsight-mini")


@pytest.mark.parametrize(
    ("sensor", "expected"), [("gelsight-mini", [12.9e-3, 14.1e-3]), ("digit", [11.5e-3, 13.6e-3])]
)
def test_the_moment_turns_the_tool_upright(sensor: str, expected: list[float]) -> None:
    """About half of what a half-space would give, 2/3 a^2 dF/d(depth), since the layer is thin.

    Expected is what the emulated gel's own solver finds for each radian, with nu 0.48 or 0.485.
    """
    moments, pressed = restoring_moments(_scene(sensor), [1.0, 3.0], math.radians(1.0))
    (d1, f1), (d3, f3) = pressed.history
    half_space = 2.0 / 3.0 * RADIUS_M**2 * (f3 - f1) / (d3 - d1)
    assert np.all((0.35 * half_space < moments) & (moments < 0.7 * half_space))
    assert moments == pytest.approx(expected, rel=0.12)


def test_a_tilt_to_the_other_side_is_the_mirror_image(scene: Scene) -> None:
    """Same depth, opposite moment."""
    there, back = (press_tilted(scene, [2.0], sign * 0.01) for sign in (1.0, -1.0))
    assert there.moments_nm == pytest.approx(-back.moments_nm, rel=1e-3)
    assert there.history[0][0] == pytest.approx(back.history[0][0], rel=1e-6)


@pytest.mark.slow
def test_a_greater_tilt_costs_more(scene: Scene) -> None:
    """A tenth of a degree is within the preset's tolerance of the image, a degree is not."""
    small, large = (tilt_costs(scene, 3.0, math.radians(tilt)) for tilt in (0.1, 1.0))
    assert small[Output.IMAGE] < 0.02 < 0.04 < large[Output.IMAGE]
    assert set(large) == set(Output)


def test_a_ball_has_no_tilt() -> None:
    """It looks alike from all sides."""
    assert not can_tilt(Sphere(diameter_m=8e-3))
    assert can_tilt(Cylinder(diameter_m=5e-3))


def test_forces_are_kept_by_what_they_depend_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same press is solved once; another gel, or a damaged file, is solved."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    solved: list[Scene] = []

    def solve(scene: Scene, depths_m: list[float], **_: object) -> FloatArray:
        solved.append(scene)
        return np.array(depths_m) / 3.0

    monkeypatch.setattr("sim.tilt_sensitivity.forces_at", solve)
    gels = [load_sensor("gelsight-mini").with_poisson(by) for by in (0.0, -0.01, 0.0)]
    scenes = [gel.scene(Sphere(diameter_m=6e-3), Target(depth_m=1e-3)) for gel in gels]
    found = [kept_forces(scene, [1e-4, 2e-4], refinement=1.0) for scene in scenes]
    assert [scene.material for scene in solved] == [gel.material for gel in gels[:2]]
    assert found[2].tolist() == found[0].tolist()
    for file in (tmp_path / "tacauchy-rig" / "forces").iterdir():
        file.write_text("1.0")
    kept_forces(scenes[0], [1e-4, 2e-4], refinement=1.0)
    assert len(solved) == 3
