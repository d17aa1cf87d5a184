"""Ball presses as a calibration renders them: shadows and blur, told apart from colours."""

import math
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.colour_fit import Calibration, calibrate_optics
from sim.optics.calibrate.shadow_blur_fit import (
    SHADOWS,
    calibrate_presses,
    calibrate_with_shadows,
    fit_blur,
    press_image,
    read_shadows,
    without_shadows,
)
from sim.optics.colour.model_interface_and_response import Response
from sim.optics.colour.nominal_optics import exponents_for
from sim.optics.render.lamp_rays import darkening
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.lamps_and_optics import Lamp, ShadowCaster
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.synthetic_presses import press_scene, presses, true_model

CIRCLE = Circle(x_px=92.0, y_px=71.0, radius_px=18.0)
ONE_LAMP = ShadowCaster(
    lamps=[Lamp(azimuth_rad=0.7, elevation_rad=math.radians(12.0), colour=(60.0, 20.0, 10.0))],
    softness_m=8e-5,
)


def _calibration(**changed: object) -> Calibration:
    model = replace(true_model(), response=Response(knee=180.0), reference=128.0)
    found = Calibration(
        model=model, scene=press_scene(), circles=(CIRCLE,), lights=np.zeros((1, 3, 3))
    )
    return replace(found, **changed)


@pytest.mark.parametrize("shadows", [None, ONE_LAMP])
@pytest.mark.parametrize("blur_px", [0.0, 1.1])
def test_a_press_is_rendered_as_a_replay_renders_it(
    shadows: ShadowCaster | None, blur_px: float
) -> None:
    """The same surface, camera, shadows and blur: images agree but where the slope has a kink."""
    found = _calibration(shadows=shadows, blur_px=blur_px)
    scene = found.scene
    bulge = scene.pressed_image(CIRCLE)[2].astype(np.float32)
    renderer = TactileRenderer(
        scene.background.astype(np.uint8),
        np.zeros(bulge.shape),
        found.model,
        scene.geometry,
        shadows=shadows,
        blur_px=blur_px,
    )
    replayed = renderer.render(-bulge.astype(np.float64)).astype(np.float64)
    off = np.abs(press_image(found, CIRCLE) - replayed)
    changed = np.abs(replayed - scene.background)
    assert changed.mean() > 20.0 * off.mean()
    assert off.mean() < 0.2
    assert np.quantile(off, 0.99) < 1.0


def test_light_that_shadows_took_comes_back() -> None:
    """A shaded press without its shadows is the press of a sensor without shadows."""
    linear = replace(true_model(), reference=None)
    bare = _calibration(model=linear)
    image = press_image(replace(bare, shadows=ONE_LAMP), CIRCLE)
    seen = BallPress(
        name="press.png", image=np.clip(np.rint(image), 0, 255).astype(np.uint8), circle=CIRCLE
    )
    lit = without_shadows(seen, CIRCLE, replace(bare, shadows=ONE_LAMP))
    plain = press_image(bare, CIRCLE)
    inside = (image > 1.0) & (image < 254.0)
    assert np.abs(lit.image - plain)[inside].max() <= 1.0
    assert without_shadows(seen, CIRCLE, bare) is seen


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
        softness_m=2e-5,
        spread=0.06,
    )


@pytest.mark.slow
def test_lamps_are_found_from_their_shadows() -> None:
    """From lamps a third too high elsewhere, directions, elevations and sizes come back."""
    scene, true = press_scene(), _caster((-75.0, 45.0), 12.0, 140.0)
    seen = []
    for press in presses(10, noise=0.5)[0]:
        gel = scene.pressed_image(press.circle).astype(np.float32)
        taken = darkening(true, gel[2], gel[:2], scene.geometry)
        image = np.clip(np.rint(press.image + taken.transpose(1, 2, 0)), 0, 255)
        seen.append(replace(press, image=image.astype(np.uint8)))
    found = calibrate_with_shadows(seen, scene, _caster((100.0, 170.0), 16.0, 80.0))
    assert found.shadows is not None
    assert found.shadows.spread == pytest.approx(true.spread, rel=0.25)
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
    assert read_shadows({"shadows": None}) is None
    with pytest.raises(ConfigError, match="older version"):
        read_shadows({"shadows": asdict(caster)})
    assert read_shadows({}) is None


@pytest.mark.parametrize(("blur_px", "low", "high"), [(0.0, 0.0, 0.3), (1.2, 0.5, 1.5)])
def test_a_blur_is_noticed(blur_px: float, low: float, high: float) -> None:
    """Sharp presses need no blur; of a blur the model itself takes up a part, no more."""
    scene = press_scene()
    found = [
        replace(press, image=_seen_through(press.image, scene.background, blur_px))
        for press in presses(8, noise=0.5)[0]
    ]
    calibration = calibrate_optics(found, scene)
    assert low <= fit_blur(calibration.placed(found), calibration) <= high


@pytest.mark.slow
def test_colours_are_fitted_to_the_sharp_gel() -> None:
    """Told of the blur, the fit takes less of it for the gel's own colours."""
    sensor = load_sensor("gelsight-mini")
    scene = replace(press_scene(), exponents=exponents_for(sensor))
    labelled, circles, _ = presses(12, noise=0.5)
    seen = [
        replace(press, image=_seen_through(press.image, scene.background, 1.2))
        for press in labelled
    ]
    plain = calibrate_optics(seen, scene)
    told = calibrate_presses(seen, scene, sensor.optics.shadows)

    def off(found: Calibration) -> float:
        sharp, true = scene.whole_image(found.model), scene.whole_image(true_model())
        both = zip(found.circles, circles, strict=True)  # colours make up for radii's error
        apart = [sharp.predict(own) - true.predict(circle) for own, circle in both]
        return float(np.abs(apart).mean())

    assert off(told) < 0.8 * off(plain)
    assert abs(told.blur_px - 1.2) < abs(fit_blur(plain.placed(seen), plain) - 1.2)
    assert told.blur_px == pytest.approx(1.2, abs=0.25)


def _seen_through(image: np.ndarray, background: np.ndarray, blur_px: float) -> np.ndarray:
    if blur_px == 0.0:
        return image
    change = cv2.GaussianBlur(image - background, (0, 0), blur_px)
    return np.clip(np.rint(background + change), 0, 255).astype(np.uint8)
