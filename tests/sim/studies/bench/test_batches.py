"""What the benchmark's batches are made of; no time is judged."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from sim.batch.environment import Trajectory
from sim.batch.pilot import batch_model
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import Sphere
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.bench.batches import (
    amid,
    batch_parts,
    pilot_for,
    pressed,
    spread,
    trajectory_of,
)

_DEPTH_M, _FRAMES, _COUNT = 0.1e-3, 2, 3


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return a shallow ball press of a sensor with markers."""
    sensor, ball = load_sensor("gelsight-mini"), Sphere(diameter_m=10e-3)
    return sensor.scene(ball, Target(depth_m=_DEPTH_M), preset=Preset.FAST)


def test_environments_differ_but_the_first(scene: Scene) -> None:
    """The first is the scene itself; others are up to a tenth stiffer and shallower."""
    trajectory = Trajectory(depths_m=np.array([0.5e-3, 1e-3]))
    young, depths = [], []
    for environment, own in spread(scene, trajectory, 5):
        assert environment.materials is not None
        young.append(environment.materials[0].young_pa)
        depths.append(own.along[-1])
    assert (young[0], depths[0]) == (scene.material.young_pa, 1e-3)
    assert len(set(young)) == len(set(depths)) == 5
    assert all(1.0 <= other / young[0] <= 1.1 for other in young)
    assert all(0.9 <= other / depths[0] <= 1.0 for other in depths)


def test_the_pilots_gel_is_amid_theirs(scene: Scene) -> None:
    """As soft as the softest, and no bulk modulus further from its own than the other way."""
    trajectory = Trajectory(depths_m=np.array([1e-3]))
    theirs = [each.materials[0] for each, _ in spread(scene, trajectory, 200) if each.materials]
    own = amid(scene).material
    assert own.young_pa == min(each.young_pa for each in theirs)
    left = [(1.0 - 2.0 * each.poisson) / (1.0 - 2.0 * own.poisson) for each in theirs]
    assert min(left) * max(left) == pytest.approx(1.0, rel=0.02)


def test_a_batch_is_seen_in_every_frame_and_its_launches_are_timed(scene: Scene) -> None:
    """Images and markers in each frame of each press, the forces as they are; no launch is free."""
    trajectory = trajectory_of(scene, frame_count=_FRAMES)
    pilot = pilot_for(scene, batch_model(scene, refinement=0.7), trajectory)
    chosen = spread(scene, trajectory, _COUNT)
    _, unseen = pressed(pilot, chosen, device="cpu")
    with (
        patch.object(SurfaceImages, "images", autospec=True) as images,
        patch.object(SurfaceImages, "markers", autospec=True) as markers,
    ):
        batch, seen = pressed(pilot, chosen, seen_by="gelsight-mini", device="cpu")
    # Once to compile and once to record the frame, before any press.
    assert images.call_count == markers.call_count == 2 + _FRAMES * len(seen)
    np.testing.assert_allclose(seen[0].force_n, unseen[0].force_n, rtol=1e-6, atol=1e-9)
    parts = batch_parts(batch, chosen, wall_s=seen[0].wall_s)
    assert list(parts) == ["stress"]
    assert parts["stress"] > 0.0


@pytest.mark.gpu
def test_launches_of_a_press_are_timed(scene: Scene) -> None:
    """Each in the press as it is; together they take no less than its steps."""
    trajectory = trajectory_of(scene, frame_count=_FRAMES)
    chosen = spread(scene, trajectory, _COUNT)
    pilot = pilot_for(scene, batch_model(scene, refinement=0.7), trajectory)
    batch, found = pressed(pilot, chosen, device="cuda:0")
    parts = batch_parts(batch, chosen, wall_s=min(each.wall_s for each in found))
    names = ["stress", "gel", "contact", "judge", "prepare", "inverse", "turn", "rest"]
    assert list(parts) == [*names, "whole step"]
    assert parts.pop("stress") > 0.0
    step_s = parts.pop("whole step")
    assert min(parts.values()) > 0.0
    assert sum(parts.values()) > 0.5 * step_s
