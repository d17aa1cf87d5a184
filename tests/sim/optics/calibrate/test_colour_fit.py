"""Colours from ball presses, and the search for lamps."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import ndimage

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.circle_and_light import PlacedPress, PressScene
from sim.optics.calibrate.colour_fit import Calibration, PressSamples, calibrate_optics
from sim.optics.calibrate.cross_validation import (
    CheckScores,
    check_scores,
    check_session,
    cross_validate,
    render_presses,
)
from sim.optics.calibrate.photometric_least_squares import (
    NormalEquations,
    PhotometricSamples,
    fit_photometric,
)
from sim.optics.colour.model_interface_and_response import LINEAR
from sim.optics.colour.photometric import BALL_EXPONENTS
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.synthetic_presses import EXPONENTS, press_scene, presses, true_model


def test_fit_recovers_the_coefficients() -> None:
    """From samples without noise, some of them not known, the fit gives the model back."""
    rng = np.random.default_rng(2)
    tilt = rng.uniform(-0.6, 0.6, (2, 4000))
    position = rng.uniform(-1, 1, (2, 4000))
    depth = rng.uniform(0, 1e-3, 4000)
    change = true_model().evaluate(tilt, position, depth)
    change[1, ::7] = -300.0
    weights = (change > -300.0).astype(np.float64)
    gel = np.stack([*tilt, depth, np.zeros(4000)])[None]
    samples = PhotometricSamples(surface=gel, position=position, change=change, weights=weights)
    fitted = fit_photometric([samples], exponents=EXPONENTS, ridge=1e-12)
    np.testing.assert_allclose(fitted.coefficients, true_model().coefficients, atol=1e-5)
    assert fitted.tilt_limit == pytest.approx(1.2 * np.hypot(*tilt).max())
    assert fitted.indentation_limit_m == pytest.approx(depth.max())


@pytest.mark.parametrize(("apart", "bends"), [(0.6, True), (0.4, False)])
def test_colours_bend_only_over_what_presses_span(apart: float, bends: bool) -> None:
    """The fourth degree in place is fitted to presses in half of the image, not to fewer."""
    rng, steep = np.random.default_rng(6), tuple(BALL_EXPONENTS.T)
    fourth = steep[2] + steep[3] == 4

    def press(middle: float) -> PhotometricSamples:
        tilt = rng.uniform(-0.5, 0.5, (2, 800))
        position = middle + rng.uniform(-0.3, 0.3, (2, 800))
        gel = np.stack([*tilt, np.zeros(800), np.zeros(800)])[None]
        change = np.tile(60.0 * tilt[0] * position[0] ** 4, (3, 1))
        ones = np.ones_like(change)
        return PhotometricSamples(surface=gel, position=position, change=change, weights=ones)

    model = fit_photometric([press(middle) for middle in np.linspace(-apart, apart, 6)])
    assert (np.abs(model.coefficients[fourth]).max() > 20.0) == bends


def test_misfit_is_what_a_fit_leaves_over() -> None:
    """The sums give the weighted squares of the residual without the samples."""
    rng = np.random.default_rng(1)
    samples = PhotometricSamples(
        surface=np.zeros((1, 4, 40)),
        position=np.zeros((2, 40)),
        change=rng.normal(0.0, 10.0, (3, 40)),
        weights=rng.integers(0, 3, (3, 40)).astype(np.float64),
    )
    features = rng.normal(0.0, 1.0, (6, 40))
    sums = NormalEquations.of(features, samples)
    coefficients = sums.solved(1e-4)
    off = (samples.change - coefficients @ features) * samples.weights
    assert sums.misfit(coefficients) == pytest.approx(np.sum(off**2))
    assert sums.known_count == np.count_nonzero(samples.weights)


def test_too_few_pixels_are_refused() -> None:
    """A fit with fewer samples than terms says so."""
    few = PhotometricSamples(
        surface=np.zeros((1, 4, 5)),
        position=np.zeros((2, 5)),
        change=np.zeros((3, 5)),
        weights=np.ones((3, 5)),
    )
    with pytest.raises(ConfigError, match="5 pixels cannot fix the"):
        fit_photometric([few], exponents=EXPONENTS)


def _fit(scene: PressScene) -> Callable[[Sequence[BallPress]], Calibration]:
    return partial(calibrate_optics, scene=scene)


@pytest.mark.slow
def test_held_out_colours_are_recovered_to_within_the_noise() -> None:
    """Good labels, steady light: held-out error is the noise of the pixels alone."""
    scene = press_scene()
    scores, _, rendered, _ = cross_validate(
        presses(12, noise=1.0)[0], scene, fit=_fit(scene), folds=3
    )
    raw = scores.as_labelled_frames_as_they_came
    noise_mae = np.sqrt(2 / np.pi) * np.hypot(1.0, np.sqrt(2 / 12))
    assert raw.mae < 1.25 * noise_mae
    assert raw.r2 > 0.99
    assert raw.mae_no_contact > 10.0
    assert len(rendered) == raw.press_count == 12


def test_circles_and_light_are_recovered() -> None:
    """Clicks off by 2 px and frames off by 10 levels: both come back, and the score with them."""
    labelled, circles, offsets = presses(14, noise=1.0, click_px=2.0, light=10.0, seed=1)
    calibration = calibrate_optics(labelled, press_scene())

    def misses(found: list[Circle]) -> np.ndarray:
        return np.array(
            [
                (a.x_px - b.x_px, a.y_px - b.y_px, a.radius_px - b.radius_px)
                for a, b in zip(found, circles, strict=True)
            ]
        )

    before = np.sqrt(np.mean(misses([press.circle for press in labelled]) ** 2))
    after = misses(list(calibration.circles))
    spread = np.sqrt(np.mean((after - after.mean(axis=0)) ** 2))
    assert before > 1.5
    assert spread < 0.25 * before
    np.testing.assert_allclose(calibration.lights[:, 0], offsets, atol=1.0)
    np.testing.assert_allclose(calibration.lights[:, 1:], 0.0, atol=1.0)
    unseen = presses(6, noise=1.0, click_px=2.0, light=10.0, seed=9)[0]
    labels, rendered = render_presses(unseen, calibration)
    scores = check_scores(labels, rendered, press_scene())
    assert [item.press.name for item in rendered] == [press.name for press in unseen]
    raw = scores.as_labelled_frames_as_they_came
    assert scores.mae < 1.3
    assert scores.r2 > 0.99 > raw.r2
    assert scores.as_labelled.mae < raw.mae
    assert scores.light_rms_levels == pytest.approx(10.0, rel=0.4)


def test_light_that_drifts_and_a_camera_that_moved_are_told() -> None:
    """Presses in ever more light, three columns beside the no-contact frame."""
    rng, scene = np.random.default_rng(4), press_scene()
    texture = ndimage.gaussian_filter(rng.normal(0.0, 9.0, scene.background.shape[:2]), 1.0)
    scene = replace(scene, background=scene.background + texture[..., None])
    still = presses(8, noise=1.0)[0]

    def scores(shift: int, drift: float) -> CheckScores:
        more = np.roll(texture, shift, 1)[..., None]
        images = [np.clip(p.image + more + drift * i, 0, 255) for i, p in enumerate(still)]
        seen = [
            replace(press, image=image.astype(np.uint8))
            for press, image in zip(still, images, strict=True)
        ]
        found = Calibration(model=true_model(), scene=scene, circles=(), lights=np.zeros((0, 3, 3)))
        return check_scores(*render_presses(seen, found), scene)

    told = check_session(scores(3, 1.0))
    assert len(told) == 2
    assert re.search(r"the light drifts by \+[67]\.\d grey levels", told[0])
    assert re.search(r"\+(2\.9|3\.\d) px to the right of and [+-]0\.\d px below", told[1])
    assert check_session(scores(0, 0.0)) == []


def test_no_contact_floor_is_the_score_of_the_no_contact_frame() -> None:
    """Presses that change nothing score about as well without a rendering as with one.

    Not quite: this no-contact frame has no noise, and that averaged over three frames has some.
    """
    scene = press_scene()
    frame = scene.background.astype(np.uint8)
    circle = Circle(x_px=90.0, y_px=75.0, radius_px=15.0)
    noisy = [
        BallPress(
            name=f"{i}.png",
            image=np.clip(frame + np.random.default_rng(i).normal(0, 3, frame.shape), 0, 255)
            .round()
            .astype(np.uint8),
            circle=circle,
        )
        for i in range(4)
    ]
    scores, _, _, _ = cross_validate(noisy, scene, fit=_fit(scene), folds=2)
    raw = scores.as_labelled_frames_as_they_came
    assert raw.ssim_crop == pytest.approx(raw.ssim_crop_no_contact, abs=0.03)
    assert raw.mae == pytest.approx(raw.mae_no_contact, rel=0.05)
    assert raw.r2 < 0.1


def test_refusals() -> None:
    """No presses and images of another size each say what is wrong."""
    scene = press_scene()
    with pytest.raises(ConfigError, match="no ball press"):
        calibrate_optics([], scene)
    small = BallPress(
        name="small.png",
        image=np.zeros((10, 20, 3), np.uint8),
        circle=Circle(x_px=5, y_px=5, radius_px=3),
    )
    with pytest.raises(ConfigError, match=r"small.png is 20 x 10 px, .* 180 x 150 px"):
        calibrate_optics([small], scene)


def test_noise_holds_a_fit_back() -> None:
    """Noisy presses choose a stronger hold on the fine terms than clean ones do."""
    scene = press_scene()

    def ridge(noise: float) -> float:
        shown, circles, _ = presses(12, noise=noise, seed=8)
        parts = [
            PressSamples(
                scene, PlacedPress(press=press, circle=circle, light=np.zeros((3, 3)))
            ).through(LINEAR)
            for press, circle in zip(shown, circles, strict=True)
        ]
        model = fit_photometric(parts, exponents=BALL_EXPONENTS, ridge=None)
        return float(str(model.provenance["ridge"]))

    assert ridge(20.0) > ridge(0.3)
