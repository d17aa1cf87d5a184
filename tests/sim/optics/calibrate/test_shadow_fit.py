"""Shadows of ball presses, told apart from colours."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from sim.optics.calibrate.colours import calibrate_optics
from sim.optics.calibrate.optics_fit import SHADOWS, calibrate_with_shadows, read_shadows
from sim.optics.render.renderer import darkening
from sim.sensor.optics import Lamp, ShadowCaster
from tests.sim.optics.synthetic_presses import press_scene, presses


def _caster(azimuths_deg: tuple[float, ...], elevation_deg: float, level: float) -> ShadowCaster:
    colours = ((level, 0.0, 0.0), (0.0, level, 0.0))
    return ShadowCaster(
        lamps=[
            Lamp(
                azimuth_rad=math.radians(azimuth),
                elevation_rad=math.radians(elevation_deg),
                colour=colour,
            )
            for azimuth, colour in zip(azimuths_deg, colours, strict=True)
        ],
        softness_m=8e-5,
    )


@pytest.mark.slow
def test_lamps_are_found_from_their_shadows() -> None:
    """From lamps a third too high that stand elsewhere, directions and elevations come back."""
    scene, true = press_scene(), _caster((-75.0, 45.0), 12.0, 140.0)
    seen = []
    for press in presses(10, noise=0.5)[0]:
        gel = scene.pressed_image(press.circle).astype(np.float32)
        taken = darkening(true, gel[2], gel[:2], scene.geometry)
        image = np.clip(np.rint(press.image + taken.transpose(1, 2, 0)), 0, 255)
        seen.append(replace(press, image=image.astype(np.uint8)))
    found = calibrate_with_shadows(seen, scene, _caster((100.0, 170.0), 16.0, 80.0))
    assert found.shadows is not None
    lamps = sorted(found.shadows.lamps, key=lambda lamp: lamp.azimuth_rad)
    for lamp, known in zip(lamps, true.lamps, strict=True):
        assert lamp.azimuth_rad == pytest.approx(known.azimuth_rad, abs=math.radians(5.0))
        assert lamp.elevation_rad == pytest.approx(known.elevation_rad, rel=0.2)
    plain = calibrate_optics(seen, scene)
    truth = calibrate_optics(presses(10, noise=0.5)[0], scene)

    def off(model: np.ndarray) -> float:
        return float(np.abs(model - truth.model.coefficients).mean())

    assert off(found.model.coefficients) < off(plain.model.coefficients)


def test_lamps_survive_a_calibration_file() -> None:
    """What the provenance holds is what was fitted; without it nothing casts a shadow."""
    caster = _caster((10.0, 20.0), 12.0, 50.0)
    assert read_shadows({SHADOWS: asdict(caster)}) == caster
    assert read_shadows({SHADOWS: None}) is None
    assert read_shadows({}) is None
