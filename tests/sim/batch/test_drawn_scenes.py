"""Batches against presses one by one, in scenes that nobody chose."""

from __future__ import annotations

import numpy as np
import pytest

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, Environment
from sim.batch.pilot import Pilot
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.press_command import scene_from
from sim.studies.bench.batches import course_of, scaled
from sim.studies.bench.scenes.press import moves

# Where points stick or slide, a force depends on the steps that led there.
_APART, _APART_WITH_FRICTION = 5e-5, 2e-3


def _drawn(random: np.random.Generator) -> str:
    size = random.uniform(3.0, 10.0)
    body = f"sphere:diameter={size:.1f}mm"
    if random.random() < 0.5:
        body = f"cylinder:diameter={size / 1.5:.1f}mm,fillet={random.uniform(0.1, 0.4):.2f}mm"
    words = [
        f"--sensor {random.choice(['gelsight-mini', 'digit'])} --preset fast --indenter {body}",
        f"--poisson {random.uniform(0.35, 0.49):.3f} --depth {random.uniform(0.15, 0.8):.2f}mm",
    ]
    if random.random() < 0.5:
        words.append(f"--contact friction:{random.uniform(0.2, 1.0):.2f} --effect friction=on")
        if random.random() < 0.5:
            words.append(f"--shift {random.uniform(0.02, 0.15):.2f}mm")
    return " ".join(words)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_batch_gives_the_presss_force(seed: int) -> None:
    """Around a pilot that goes a tenth further, and beside one pressed less deep."""
    words = _drawn(np.random.default_rng(1000 + seed))
    scene = scene_from(words)
    path = path_for(scene, plan_effects(scene))
    course = course_of(scene, frame_count=20)
    pilot = Pilot(path.model, scene.indenter, scaled(course, 1.1), scene.centre_m, count=10)
    batch = Batch(pilot, [Environment()] * 2, options=BatchOptions(residual_relative=1e-5))
    found = batch.press([course, scaled(course, 0.93)])
    single = [move(path) for move in moves(scene)][-1].force_n
    assert not found.failed.any(), words
    apart = np.linalg.norm(found.force_n[-1, 0] - single) / np.linalg.norm(single)
    assert apart <= (_APART_WITH_FRICTION if "friction" in words else _APART), words
