"""Scenes pressed alone and in batches."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from sim.batch.batch import Batch
from sim.batch.sensor_model import sensor_model
from sim.optics.surface_images import SurfaceImages
from sim.press import press
from sim.scene.indenter import Sphere
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.bench.scenes import FRAME_COUNT, Manner, all_scenes
from sim.studies.bench.timed_press import (
    moves,
    press_in_frames,
    press_scene,
    pressed,
    spread,
    stated_scene,
    stress_s,
    trajectory_of,
    within,
)
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError


def test_frames_end_where_one_press_does() -> None:
    """Twenty frames, the force of one press to the same depth, in balance."""
    scene = replace(stated_scene(all_scenes()["ball, shallow"]), preset=Preset.FAST, refinement=0.7)
    found = press_in_frames(scene, is_timed=False)
    alone = press(scene)
    assert found.force_n[2] == pytest.approx(alone.force_n[2], rel=1e-5)
    assert found.depth_m == pytest.approx(scene.target.depth_m)
    assert found.iterations >= FRAME_COUNT
    assert found.balance < 1e-5
    assert found.stiffness_n_m > 0.0


def test_a_corrected_scene_ends_on_its_own_mesh() -> None:
    """Frames on the way's mesh, and the end that ``press`` finds."""
    shallow = stated_scene(all_scenes()["ball, shallow"])
    scene, is_stated = within(shallow, "5%", corrected=True)
    found, alone = press_in_frames(scene, is_timed=False), press(scene)
    assert is_stated
    assert found.corrected is not None
    assert alone.corrected is not None
    assert found.force_n[2] == pytest.approx(alone.force_n[2], rel=2e-3)
    assert found.corrected.force_n == pytest.approx(alone.corrected.force_n, rel=2e-3)
    assert found.tet_count == alone.tet_count


def test_a_motion_takes_half_of_the_frames() -> None:
    """Down in ten, then along in ten; straight presses go down in all."""
    sliding, straight = (
        stated_scene(all_scenes()[name]) for name in ("ball, sliding", "ball, shallow")
    )
    assert len(moves(sliding)) == len(moves(straight)) == FRAME_COUNT
    held = _Recorder()
    for move in moves(sliding):
        move(held)  # type: ignore[arg-type]
    assert held.pushed_n == pytest.approx([0.1 * k for k in range(1, 11)])
    assert sum(held.shifted_m) == pytest.approx(0.3e-3)
    assert len(held.shifted_m) == FRAME_COUNT // 2


class _Recorder:
    """Takes the moves of a path and remembers them."""

    def __init__(self) -> None:
        self.pushed_n: list[float] = []
        self.shifted_m: list[float] = []

    def push(self, force_n: float, *, duration_s: float) -> None:
        assert duration_s > 0.0
        self.pushed_n.append(force_n)

    def carry(self, *, shift_m: tuple[float, float], **_others: object) -> None:
        self.shifted_m.append(shift_m[0])


def test_a_tolerance_that_nothing_promises_still_chooses() -> None:
    """A promised setting is said to be; where none is, the preset is as fine as is usual."""
    straight = stated_scene(all_scenes()["punch, rounded"])
    assert within(straight, "5%")[1]
    scene, is_promised = within(straight, "0.01%")
    assert not is_promised
    assert scene.preset is Preset.ACCURATE
    with pytest.raises(ConfigError, match="--tolerance"):
        within(straight, "5")


@pytest.mark.slow
def test_a_batch_presses_the_scene_too() -> None:
    """Friction and all: the first environment's force is the scene's, within what is stated."""
    stated = {"indenter": "sphere:diameter=10mm", "depth": "0.3mm", "contact": "friction:0.5"}
    alone = press_in_frames(within(stated_scene(stated), "5%")[0])
    one, two = (press_scene(stated, Manner(environments=count)) for count in (1, 2))
    assert one["force_n"] == pytest.approx(two["force_n"], rel=1e-3, abs=1e-4)
    assert two["force_n"][2] == pytest.approx(alone.force_n[2], rel=0.1)
    assert two["balance"] <= 1e-3
    assert two["depth_m"] == pytest.approx(0.3e-3)


_DEPTH_M, _FRAMES, _COUNT = 0.1e-3, 2, 3


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return a shallow ball press of a sensor with markers."""
    sensor, ball = load_sensor("gelsight-mini"), Sphere(diameter_m=10e-3)
    return sensor.scene(ball, Target(depth_m=_DEPTH_M), preset=Preset.FAST)


def test_environments_differ_but_the_first(scene: Scene) -> None:
    """The first is the scene itself; others are up to a tenth stiffer and shallower."""
    gels, shares = spread(scene, 5)
    young = [gel[0].young_pa for gel in gels]
    assert (young[0], shares[0]) == (scene.material.young_pa, 1.0)
    assert len(set(young)) == len(set(shares)) == 5
    assert all(1.0 <= other / young[0] <= 1.1 for other in young)
    assert all(0.9 <= share <= 1.0 for share in shares)


def _batch(scene: Scene, device: str = "cpu") -> tuple[Batch, FloatArray]:
    pad = scene.pad
    assert isinstance(pad, BoxPad)
    model = sensor_model(pad, scene.material, edge_m=3e-3, device=device)
    gels, shares = spread(scene, _COUNT)
    poses, loads_n = trajectory_of(scene, model, shares=shares, frame_count=_FRAMES)
    assert loads_n is None
    return Batch(model, [scene.indenter], np.zeros(_COUNT, int), materials=gels), poses


def test_a_batch_is_seen_in_every_frame_and_its_launches_are_timed(scene: Scene) -> None:
    """Images and markers in each frame of a press, the forces as they are; no launch is free."""
    batch, poses = _batch(scene)
    unseen = pressed(batch, poses, None)
    with (
        patch.object(SurfaceImages, "images", autospec=True) as images,
        patch.object(SurfaceImages, "markers", autospec=True) as markers,
    ):
        seen = pressed(batch, poses, None, seen_by="gelsight-mini")
    assert images.call_count == markers.call_count == _FRAMES
    np.testing.assert_allclose(seen[-1].wrench, unseen[-1].wrench, rtol=1e-6, atol=1e-9)
    assert stress_s(batch) > 0.0
