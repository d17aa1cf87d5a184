"""Grey-depth rendering, and shadows of the pressed gel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from sim.optics.calibrate.photometric_fit import PhotometricSamples, fit_photometric
from sim.optics.colour.colour_model import PixelColours, SampleColours
from sim.optics.colour.nominal import GREY_EXPONENTS, GreyDepthModel, nominal_photometric
from sim.optics.pixels.pixel_blocks import PixelBlocks
from sim.optics.render.renderer import TactileRenderer, darkening
from sim.sensor.optics import Lamp, ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, RealArray
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, ball_press, camera, surface_tilt

LAMP = Lamp(azimuth_rad=0.0, elevation_rad=math.radians(10.0), colour=(80.0, 0.0, 0.0))
FLAT = np.full((96, 128), APEX_M)


def _dent(depth_m: float = 8e-4) -> np.ndarray:
    return ball_press(
        *camera().pad_grid(),
        ball_radius_m=2.35e-3,
        contact_radius_m=1.2e-3,
        tip_z_m=APEX_M - depth_m,
    )


def test_deeper_is_darker() -> None:
    """The grey image has one level a depth, all channels alike, and is untouched at rest."""
    model = GreyDepthModel((0.0, 5e-4, 1e-3), (0.0, -40.0, -60.0))
    background = np.full((96, 128, 3), 150, np.uint8)
    renderer = TactileRenderer(background, FLAT, model, camera())
    np.testing.assert_array_equal(renderer.render(FLAT), background)
    image = renderer.render(FLAT - 5e-4)
    np.testing.assert_array_equal(image, 110)
    dent = renderer.render(_dent()).astype(int)
    assert dent[47, 63, 0] < dent[47, 80, 0] < dent[47, 120, 0] <= 150
    np.testing.assert_array_equal(dent[..., 0], dent[..., 2])


def test_a_function_of_numpy_renders_what_a_kernel_does() -> None:
    """Several samples a pixel, a width of no whole block, two images at once: within a level."""
    model = nominal_photometric([LAMP])

    @dataclass(frozen=True)
    class InNumpy:
        provenance: Mapping[str, object]

        def over(self, frame: Float32Array, _layout: PixelBlocks) -> PixelColours:
            return PixelColours(light=frame, function=self.change)

        def change(self, tilt: Float32Array, indentation_m: Float32Array) -> RealArray:
            flat, place = tilt.reshape(2, -1), np.zeros((2, indentation_m.size), np.float32)
            change = model.evaluate(flat, place, indentation_m.ravel())
            return change.reshape(3, *indentation_m.shape)

    view = replace(camera(), width=101)
    fine = view.refined(2)
    x, y = fine.pad_grid()
    rest = np.full(x.shape, APEX_M)
    dent = np.maximum(0.0, 6e-4 - (x**2 + 2.0 * (y - 4e-4) ** 2) / 4e-3)
    background = np.full((view.height, view.width, 3), 90, np.uint8)
    images = []
    for each in (model, InNumpy({})):
        renderer = TactileRenderer(background, rest, each, view, samples=2, blur_px=0.6)
        room, render = renderer.prepared(2)
        room.assign(np.stack([dent, 0.5 * dent]).astype(np.float32))
        images.append(render().numpy().astype(int))
    assert images[0].max() > 100
    assert np.abs(images[1] - images[0]).max() <= 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda tilt, _dent: tilt, r"change of light has the shape \(2, 96, 128\)"),
        (lambda _tilt, dent: np.stack([np.log(dent - 1.0)] * 3), "is not finite"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value encountered in log")
def test_what_a_function_of_numpy_gets_wrong_is_told(change: SampleColours, message: str) -> None:
    """A wrong shape, and a logarithm of what is negative, which would pass as a grey level."""

    class Wrong:
        provenance: ClassVar = {}

        def over(self, frame: Float32Array, _layout: PixelBlocks) -> PixelColours:
            return PixelColours(light=frame, function=change)

    with pytest.raises(ConfigError, match=message):
        TactileRenderer(np.full((96, 128, 3), 90, np.uint8), FLAT, Wrong(), camera())


def test_grey_is_fitted_with_depth_alone() -> None:
    """A saturating darkening is recovered to half a grey level whatever the slopes."""
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.0, 1.2e-3, 3000)
    change = -90.0 * (1.0 - np.exp(-depth / 8e-4))
    tilt, position = rng.uniform(-0.5, 0.5, (2, 3000)), rng.uniform(-1, 1, (2, 3000))
    samples = PhotometricSamples(
        surface=np.stack([*tilt, depth, np.zeros(3000)])[None],
        position=position,
        change=np.tile(change, (3, 1)),
        weights=np.ones((3, 3000)),
    )
    model = fit_photometric([samples], exponents=GREY_EXPONENTS)
    assert np.abs(model.evaluate(tilt, position, depth) - change).max() < 0.5


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 200.0])
def test_shadow_falls_away_from_the_lamp(azimuth_deg: float) -> None:
    """Behind the dent, as seen from the lamp, its colour is lost; before it, nothing is."""
    lamp = Lamp(
        azimuth_rad=math.radians(azimuth_deg),
        elevation_rad=math.radians(10.0),
        colour=(80.0, 0.0, 0.0),
    )
    caster = ShadowCaster(lamps=[lamp], softness_m=5e-5)
    dent = _dent()
    taken = darkening(caster, APEX_M - dent, surface_tilt(dent, camera()), camera())
    direction = np.array([math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)])
    behind = np.rint((63.5, 47.5) - 25 * direction).astype(int)
    before = np.rint((63.5, 47.5) + 25 * direction).astype(int)
    assert taken[0, behind[1], behind[0]] < -4.0
    assert taken[0, before[1], before[0]] == 0.0
    np.testing.assert_array_equal(taken[1:], 0.0)
    assert taken.max() <= 0.0


def test_shadow_ends_where_the_ray_clears_the_dent() -> None:
    """A wall of 0.3 mm under a lamp at 10 degrees shades 0.3 mm / tan 10 = 1.70 mm behind it."""
    wall = np.zeros((96, 128), np.float32)
    wall[:, 100] = 3e-4
    flat = np.zeros((2, 96, 128), np.float32)
    caster = ShadowCaster(lamps=[LAMP], softness_m=1e-9)
    row = darkening(caster, wall, flat, camera())[0, 48]
    shaded = np.flatnonzero(row < -1.0)
    assert shaded.max() == 99
    assert (100 - shaded.min()) * 1e-4 == pytest.approx(3e-4 / math.tan(math.radians(10)), abs=2e-4)
