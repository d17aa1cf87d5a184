"""Batches against presses one by one, in scenes that nobody chose."""

from __future__ import annotations

import numpy as np
import pytest

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, Environment
from sim.batch.pilot import Pilot
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.studies.bench.press import moves, scaled, stated_scene, trajectory_of
from sim.studies.bench.scenes import drawn_scenes

# Where points stick or slide, a force depends on the steps that led there.
_APART, _APART_WITH_FRICTION = 5e-5, 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", list(drawn_scenes(1000))[1:3])
def test_a_batch_gives_the_presss_force(name: str) -> None:
    """Around a pilot that goes a tenth further, and beside one pressed less deep."""
    scene = stated_scene({**drawn_scenes(1000)[name], "preset": "fast"})
    path = path_for(scene, plan_effects(scene))
    trajectory = trajectory_of(scene, frame_count=20)
    pilot = Pilot(path.model, scene.indenter, scaled(trajectory, 1.1), scene.centre_m, count=10)
    batch = Batch(pilot, [Environment()] * 2, options=BatchOptions(residual_relative=1e-5))
    found = batch.press([trajectory, scaled(trajectory, 0.93)])
    single = [move(path) for move in moves(scene)][-1]
    assert not found.failed.any()
    allowed = _APART_WITH_FRICTION if scene.friction else _APART
    apart = np.linalg.norm(found.force_n[-1, 0] - single.force_n) / np.linalg.norm(single.force_n)
    assert apart <= allowed
    assert found.depth_m[-1, 0] == pytest.approx(single.depth_m, rel=allowed)
