"""The camera's blur from ball presses, and pixels that gather the light of their whole area."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sim.optics.calibrate.colours import Calibration, calibrate_optics
from sim.optics.calibrate.optics_fit import calibrate_presses, fit_blur
from sim.optics.colour.nominal import exponents_for
from sim.sensor.sensor import load_sensor
from tests.sim.optics.synthetic_presses import press_scene, presses, true_model


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
        apart = [sharp.predict(circle) - true.predict(circle) for circle in circles]
        return float(np.abs(apart).mean())

    assert off(told) < 0.8 * off(plain)
    assert abs(told.blur_px - 1.2) < abs(fit_blur(plain.placed(seen), plain) - 1.2)
    assert told.blur_px == pytest.approx(1.2, abs=0.25)


def _seen_through(image: np.ndarray, background: np.ndarray, blur_px: float) -> np.ndarray:
    if blur_px == 0.0:
        return image
    change = cv2.GaussianBlur(image - background, (0, 0), blur_px)
    return np.clip(np.rint(background + change), 0, 255).astype(np.uint8)
