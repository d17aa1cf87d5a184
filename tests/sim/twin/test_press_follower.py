"""The follower: the press of a force from where it stands, and back, and its images and maps."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.press_with_effects import path_for
from sim.press import press
from sim.replay import replay_scene
from sim.scene.indenter import Cylinder
from sim.scene.scene import Preset, Target
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import LoadingPath
from sim.twin.press_follower import Follower, Goal, ImageOptions, twin_scene
from tacauchy_rig.core.errors import ConfigError, ConvergenceError

SENSOR = load_sensor("gelsight-mini")
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.2e-3)
SCENE = replay_scene(SENSOR, PUNCH, [2.0], preset=Preset.FAST)


@pytest.fixture(scope="module")
def shared() -> Follower:
    """Return a follower; tests leave it wherever they pressed it to."""
    return Follower(SCENE, SENSOR)


@pytest.fixture
def follower(shared: Follower) -> Follower:
    """Return a follower that touches nothing."""
    shared.follow(Goal(stamp_s=0.0, force_n=0.0))
    return shared


def test_a_followed_force_is_a_press_of_that_force(follower: Follower) -> None:
    """On the way over other forces: the same depth, force and moment's worth of image."""
    for force in (0.2, 0.7, 1.3):
        frame = follower.follow(Goal(stamp_s=force, force_n=force))
    alone = press(replace(twin_scene(SCENE), target=Target(force_n=1.3)))
    assert frame.force_n == pytest.approx(1.3, rel=1e-4)
    assert frame.depth_m == pytest.approx(alone.depth_m, rel=1e-3)
    other = Follower(SCENE, SENSOR).follow(Goal(stamp_s=0.0, force_n=1.3))
    apart = np.abs(frame.image.astype(int) - other.image.astype(int))
    assert apart.max() <= 2


def test_a_replay_on_the_fine_mesh_lies_within_the_error_that_is_stated(follower: Follower) -> None:
    """At the depth of the twin, preset balanced's F_z is off by no more than the error bar."""
    frame = follower.follow(Goal(stamp_s=0.0, force_n=1.5))
    fine = press(replace(SCENE, preset=Preset.BALANCED, target=Target(depth_m=frame.depth_m)))
    assert frame.force_error_n is not None
    assert abs(fine.force_n[2] - 1.5) < frame.force_error_n


def test_a_followed_force_is_balanced_no_closer_than_a_twin_needs(follower: Follower) -> None:
    """To 1e-5 of it, in fewer steps than a press to a force takes, at the same depth."""
    close = path_for(follower._scene, follower._plan, model=follower._path.model)
    spent = np.zeros(2)
    for force in 0.5 + 0.05 * np.arange(12):
        exact, loose = close.push(force), follower._pressed(Goal(stamp_s=0.0, force_n=force))
        spent += [each.equilibrium.iterations for each in (exact, loose)]
        assert exact.equilibrium.residual_n < 1e-7 * force
        assert loose.equilibrium.residual_n < 1e-5 * force
        assert loose.depth_m == pytest.approx(exact.depth_m, rel=1e-4)
    assert spent[1] < spent[0]


def test_unloading_leads_back(follower: Follower) -> None:
    """Of a gel that remembers nothing a force has one image, whichever way it was come by."""
    up = follower.follow(Goal(stamp_s=0.0, force_n=0.6))
    follower.follow(Goal(stamp_s=1.0, force_n=1.8))
    down = follower.follow(Goal(stamp_s=2.0, force_n=0.6))
    assert down.depth_m == pytest.approx(up.depth_m, rel=1e-3)
    assert np.abs(down.image.astype(int) - up.image.astype(int)).max() <= 2


def test_no_contact_is_the_frame_without_contact(follower: Follower) -> None:
    """Bit by bit, with maps of nothing; after a press too."""
    rng = np.random.default_rng(0)
    shape = (follower.view.height, follower.view.width, 3)
    background = rng.integers(60, 180, shape).astype(np.uint8)
    follower.unloaded(background)
    assert not np.array_equal(follower.follow(Goal(stamp_s=0.0, force_n=1.0)).image, background)
    frame = follower.follow(Goal(stamp_s=1.0, force_n=-0.1))
    follower.unloaded(None)
    np.testing.assert_array_equal(frame.image, background)
    assert frame.force_n == 0.0
    assert frame.pressure_pa is not None
    assert not frame.pressure_pa.any()


def test_a_depth_is_followed_too(follower: Follower) -> None:
    """The arm's depth in place of the force: the depth is met, and its force found."""
    by_force = follower.follow(Goal(stamp_s=0.0, force_n=1.0))
    follower.follow(Goal(stamp_s=1.0, force_n=0.3))
    by_depth = follower.follow(Goal(stamp_s=2.0, depth_m=by_force.depth_m))
    assert by_depth.depth_m == pytest.approx(by_force.depth_m, rel=1e-9)
    assert by_depth.force_n == pytest.approx(1.0, rel=1e-3)


def test_the_pressure_map_carries_the_force(follower: Follower) -> None:
    """Its sum over the pad is F_z, within what a coarse map loses at the rim."""
    frame = follower.follow(Goal(stamp_s=0.0, force_n=1.5))
    assert frame.pressure_pa is not None
    view = follower.view.refined(0.5)
    carried = frame.pressure_pa.sum() * view.scale_x_m * view.scale_y_m
    assert carried == pytest.approx(1.5, rel=0.15)


def test_a_press_that_fails_shows_the_last_and_says_so(
    follower: Follower, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the next one is pressed again."""
    before = follower.follow(Goal(stamp_s=0.0, force_n=1.0))

    def fail(*_: object, **__: object) -> None:
        raise ConvergenceError("the press stopped at 0.1 mm")

    with monkeypatch.context() as patched:
        patched.setattr(LoadingPath, "push", fail)
        frame = follower.follow(Goal(stamp_s=1.0, force_n=1.4))
    assert "stopped at 0.1 mm" in frame.note
    np.testing.assert_array_equal(frame.image, before.image)
    after = follower.follow(Goal(stamp_s=2.0, force_n=1.4))
    assert after.note == ""
    assert after.force_n == pytest.approx(1.4, rel=1e-4)


def test_a_scene_without_a_force_is_refused() -> None:
    """What a twin's forces are worth is found at the largest."""
    with pytest.raises(ConfigError, match="no force for a target"):
        Follower(replace(SCENE, target=Target(depth_m=1e-4)), SENSOR)


@pytest.mark.gpu
def test_a_follower_on_a_gpu_shows_what_one_on_a_processor_shows(follower: Follower) -> None:
    """The same depth, and the same image within a level or two."""
    on_gpu = Follower(SCENE, SENSOR, ImageOptions(device="cuda:0"))
    theirs, ours = (each.follow(Goal(stamp_s=0.0, force_n=1.3)) for each in (on_gpu, follower))
    assert theirs.depth_m == pytest.approx(ours.depth_m, rel=1e-3)
    assert np.abs(theirs.image.astype(int) - ours.image.astype(int)).max() <= 2
