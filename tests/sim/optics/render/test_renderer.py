"""Renderings: colours, grey by depth, and shadows."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.optics.calibrate.photometric_least_squares import PhotometricSamples, fit_photometric
from sim.optics.colour.model_interface_and_response import PixelColours, SampleColours
from sim.optics.colour.nominal_optics import GREY_EXPONENTS, GreyDepthModel, nominal_photometric
from sim.optics.colour.photometric import PhotometricModel, load_photometric, polynomial_exponents
from sim.optics.pixels.pixel_blocks import PixelBlocks
from sim.optics.render.lamp_rays import darkening
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.lamps_and_optics import Lamp, ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, RealArray
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, ball_press, camera, surface_tilt

RED_FROM_THE_RIGHT = Lamp(azimuth_rad=0.0, elevation_rad=0.3, colour=(80.0, 0.0, 0.0))


def _background() -> np.ndarray:
    return np.random.default_rng(1).integers(60, 190, (96, 128, 3)).astype(np.uint8)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), degree=st.integers(1, 4), place=st.integers(0, 2))
def test_unloaded_gel_gives_the_no_contact_frame(seed: int, degree: int, place: int) -> None:
    """For every model and every rest shape the unloaded image is the background, bit for bit."""
    rng = np.random.default_rng(seed)
    exponents = polynomial_exponents(
        tilt_degree=degree,
        position_degree=place,
        indentation_degree=1,
        indentation_tilt_degree=degree - 1,
    )
    model = PhotometricModel(
        exponents=exponents, coefficients=rng.normal(0, 40, (len(exponents), 3))
    )
    x, y = camera().pad_grid()
    dome = APEX_M - (x**2 + y**2) / (2 * rng.uniform(0.02, 0.2))
    image = TactileRenderer(_background(), dome, model, camera()).render(dome)
    np.testing.assert_array_equal(image, _background())


def test_nominal_model_is_lambert() -> None:
    """Colour change equals colour x (cosine of incidence - cosine at rest) up to 45 degrees."""
    model = nominal_photometric([replace(RED_FROM_THE_RIGHT, colour=(40.0, 0.0, 0.0))])
    for angle in (-0.7, -0.2, 0.3, 0.7):
        tilt = np.array([[math.sin(angle)], [0.0]], dtype=np.float32)
        change = model.evaluate(tilt, np.zeros((2, 1), np.float32), np.zeros(1, np.float32))
        expected = 40.0 * (math.sin(0.3 + angle) - math.sin(0.3))
        assert change[0, 0] == pytest.approx(expected, abs=0.2)


def test_three_lamps_light_their_own_flanks() -> None:
    """Each colour is brightest where the dent faces its lamp, 120 degrees apart."""
    model = nominal_photometric(
        [
            Lamp(
                azimuth_rad=math.radians(azimuth),
                elevation_rad=math.radians(10.0),
                colour=(70.0 * (channel == 0), 70.0 * (channel == 1), 70.0 * (channel == 2)),
            )
            for channel, azimuth in enumerate((-60.0, 60.0, 180.0))
        ]
    )
    background = np.full((96, 128, 3), 100, np.uint8)
    image = TactileRenderer(background, FLAT, model, camera()).render(_small_dent()).astype(float)
    rows, columns = np.mgrid[:96, :128]
    for channel, azimuth in enumerate((-60.0, 60.0, 180.0)):
        excess = np.maximum(image[..., channel] - 100.0, 0.0)
        x, y = np.sum(excess * (columns - 63.5)), np.sum(excess * (rows - 47.5))
        assert math.cos(math.atan2(y, x) - math.radians(azimuth)) > 0.99


def test_steeper_than_fitted_is_rendered_as_the_limit() -> None:
    """Beyond the tilt limit the colour keeps its direction and stops growing."""
    exponents = polynomial_exponents(tilt_degree=1, position_degree=0)
    model = PhotometricModel(
        exponents=exponents, coefficients=np.array([[10.0, 0, 0], [0, 20.0, 0]]), tilt_limit=0.5
    )
    tilt = np.array([[0.6, 0.3], [0.8, 0.0]], dtype=np.float32)
    change = model.evaluate(tilt, np.zeros((2, 2), np.float32), np.zeros(2, np.float32))
    np.testing.assert_allclose(change.T, [[3.0, 8.0, 0.0], [3.0, 0.0, 0.0]], atol=1e-4)


def test_background_of_another_size_is_refused() -> None:
    """A raw camera frame in place of the cropped one names both shapes."""
    model = nominal_photometric([RED_FROM_THE_RIGHT])
    flat = np.full((96, 128), APEX_M)
    with pytest.raises(ConfigError, match=r"no-contact frame has the shape \(480, 640, 3\)"):
        TactileRenderer(np.zeros((480, 640, 3), np.uint8), flat, model, camera())


@pytest.mark.parametrize("content", [None, b"", b"not a calibration"])
def test_missing_or_foreign_file_is_refused(tmp_path: Path, content: bytes | None) -> None:
    """The message names the file and the command that writes one."""
    path = tmp_path / "calibration.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"calibration.npz[\s\S]*calibrate optics"):
        load_photometric(path)


def test_archive_of_something_else_is_refused(tmp_path: Path) -> None:
    """An npz without the model's keys is refused, not half read."""
    np.savez(tmp_path / "other.npz", height=np.zeros(3))
    with pytest.raises(ConfigError, match="not an optics calibration"):
        load_photometric(tmp_path / "other.npz")


LAMP = Lamp(azimuth_rad=0.0, elevation_rad=math.radians(10.0), colour=(80.0, 0.0, 0.0))
FLAT = np.full((96, 128), APEX_M)


def _small_dent(depth_m: float = 8e-4) -> np.ndarray:
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
    dent = renderer.render(_small_dent()).astype(int)
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
        (lambda tilt, _small_dent: tilt, r"change of light has the shape \(2, 96, 128\)"),
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
    dent = _small_dent()
    taken = darkening(caster, APEX_M - dent, surface_tilt(dent, camera()), camera())
    direction = np.array([math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)])
    behind = np.rint((63.5, 47.5) - 25 * direction).astype(int)
    before = np.rint((63.5, 47.5) + 25 * direction).astype(int)
    assert taken[0, behind[1], behind[0]] < -4.0
    assert taken[0, before[1], before[0]] == 0.0
    np.testing.assert_array_equal(taken[1:], 0.0)
    assert taken.max() <= 0.0


def test_gel_beside_the_image_casts_no_shadow() -> None:
    """Gel that bulges away from the camera up to the border goes on beside it."""
    lamp = Lamp(azimuth_rad=0.52, elevation_rad=0.26, colour=(80.0, 0.0, 0.0), distance_m=0.018)
    caster = ShadowCaster(lamps=(lamp,), softness_m=2e-5, spread=0.1)
    bulge, flat = np.full((96, 128), -2e-4, np.float32), np.zeros((2, 96, 128), np.float32)
    np.testing.assert_array_equal(darkening(caster, bulge, flat, camera()), 0.0)


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
