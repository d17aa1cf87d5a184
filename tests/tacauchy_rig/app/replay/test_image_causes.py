"""A replay with one thing wrong: pressed again, that thing explains its images."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from reports.evidence.evidence import TrialImages
from reports.scores.residual_split import UNMENDABLE, Cause
from sim.replay import replay_forces
from sim.scene.scene import Preset
from tacauchy_rig.app.replay.inputs import ReplayInputs, inputs_of
from tacauchy_rig.app.replay.optics import nominal_optics
from tacauchy_rig.app.replay.rendering import replay_images
from tacauchy_rig.app.replay.replay import SplitPart, split_images
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.simulated import ResidualSplit

FORCES_N = (2.0, 4.0)


def _inputs() -> ReplayInputs:
    return replace(inputs_of(load_config().config), preset=Preset.FAST, tolerance=None)


def _images(inputs: ReplayInputs) -> dict[int, ImageArray]:
    """Return what a lamp-lit gel shows, pressed to each force."""
    _, fields = replay_forces(inputs.scene(FORCES_N), FORCES_N)
    render = replay_images(inputs.sensor)
    return {k: render(each.surface) for k, each in enumerate(fields, start=1)}


def _split(true: Mapping[int, ImageArray], believed: ReplayInputs) -> ResidualSplit | None:
    optics = nominal_optics(believed.sensor)
    grey = np.full_like(true[1], 110)
    attempts: list[Any] = [
        SimpleNamespace(
            record=SimpleNamespace(index=k, force_measured_n=force_n),
            images=TrialImages(real=true[k], reference=grey),
        )
        for k, force_n in enumerate(FORCES_N, start=1)
    ]
    config = load_config().config
    part = SplitPart(attempts=attempts, inputs=believed)
    return split_images([part], _images(believed), optics, config, on_progress=lambda _: None)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_lean_or_a_modulus_that_is_wrong_comes_first() -> None:
    """A degree of lean, and a gel that is 15 % stiffer than it is; and not much is left."""
    true = _inputs()
    seen = _images(true)
    leaning = replace(true, tilt_rad=(math.radians(1.0), 0.0))
    stiff = replace(true, sensor=true.sensor.stiffer(1.15))
    for believed, cause in ((leaning, Cause.TILT), (stiff, Cause.MATERIAL)):
        split = _split(seen, believed)
        assert split is not None
        mendable = [name for name in split.shares if Cause(name) not in UNMENDABLE]
        assert mendable[0] == cause
