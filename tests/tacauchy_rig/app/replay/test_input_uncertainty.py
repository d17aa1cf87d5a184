"""What uncertain inputs change of a force and of images, tried by the simulator."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from reports.evidence.evidence_types import TrialImages
from reports.scores.residual_causes import UNMENDABLE, Cause
from sim.replay import replay_forces
from sim.scene.indenter import Cylinder
from sim.scene.scene import Preset
from sim.tilt_sensitivity import forces_at
from tacauchy_rig.app.replay.chosen_optics import nominal_optics
from tacauchy_rig.app.replay.rendering import replay_images
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs, inputs_of
from tacauchy_rig.app.replay.uncertain_inputs import _quick, force_inputs, split_images, variations
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.simulated import FoundValue, ResidualSplit
from tests.tacauchy_rig.app.importing.test_places import CUBE

BALL = ('indenter.kind="sphere"', 'indenter.diameter="8 mm"', 'indenter.fillet="0 mm"')
SMOOTH = ("replay.friction=0", "uncertainty.friction=0")


def _found(name: str, value: float, uncertainty: float, *, taken: bool) -> FoundValue:
    return FoundValue(
        name=name, value=value, uncertainty=uncertainty, unit="rad", taken=taken, basis="made up"
    )


@pytest.mark.slow
def test_a_ball_in_a_gel_by_what_hertz_says() -> None:
    """F goes with the root of the diameter; a thinner gel and a larger nu are stiffer."""
    config = load_config(overrides=(*BALL, *SMOOTH, 'uncertainty.diameter="0.4 mm"')).config
    found = {each.name: each for each in force_inputs(inputs_of(config), config, [2e-4])}
    assert "tilt of the indenter" not in found
    (diameter,) = found["indenter's diameter"].changes or ()
    assert diameter == pytest.approx(0.5 * 0.4 / 8.0, rel=0.35)
    (friction,) = found["friction"].changes or ()
    assert friction == 0.0
    (poisson,), (height,) = (
        found[name].changes or () for name in ("Poisson's ratio", "gel height")
    )
    assert 0.01 < poisson < 0.05
    assert 0.005 < height < 0.03
    assert "default" not in found["indenter's diameter"].basis


def test_what_was_found_takes_the_place_of_a_default() -> None:
    """A lean that is not simulated is missed by itself, one that is by its uncertainty."""
    config = load_config(overrides=SMOOTH).config
    missed = [_found("lean towards x", 3e-3, 4e-3, taken=False)]
    missed += [_found("lean towards y", 0.0, 0.0, taken=False)]
    for found, wanted in (
        (missed, 5e-3),
        ([replace(each, taken=True) for each in missed], 4e-3),
        ([], np.sqrt(2.0 / 3.0) * np.radians(2.0)),
    ):
        tilt = {v.name: v for v in variations(inputs_of(config), config, found=found)}[
            "tilt of the indenter"
        ]
        assert tilt.stated.value == pytest.approx(wanted)
        assert tilt.changed(0.1).tilt_rad == (0.1, 0.0)


def test_triangles_are_tried_as_a_punch_of_their_footprint(tmp_path: Path) -> None:
    """A cube of 4 mm is a punch of 16 mm^2, and its terms say so."""
    cube = tmp_path / "cube.stl"
    cube.write_bytes(CUBE)
    named = f'replay.indenter="mesh:{cube},unit=mm"'
    quick, how = _quick(inputs_of(load_config(overrides=[named]).config), 3e-4)
    assert isinstance(quick.indenter, Cylinder)
    area_mm2 = np.pi * (1e3 * quick.indenter.radius_m) ** 2
    assert area_mm2 == pytest.approx(16.0, rel=0.05)
    assert "round punch" in how


def test_depths_count_from_the_contact_force() -> None:
    """From a force on a press is deeper than from touch on, and so is its force."""
    config = load_config(overrides=(*BALL, *SMOOTH)).config
    scene = inputs_of(config).scene([2.0])
    at_touch, later = (
        forces_at(scene, [3e-4], contact_force_n=force_n, refinement=0.5)[0]
        for force_n in (0.0, 0.05)
    )
    assert later > at_touch + 0.05


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
    return split_images([(believed, attempts)], _images(believed), {}, optics, config)


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
