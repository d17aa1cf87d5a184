"""Lamps and creases of the photometric model, and the camera's response."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.optics.calibrate.circle_and_light import seen_change
from sim.optics.calibrate.colour_fit import calibrate_optics
from sim.optics.calibrate.photometric_least_squares import (
    PhotometricSamples,
    fit_photometric,
    fit_terms,
)
from sim.optics.colour.model_interface_and_response import LINEAR, Response
from sim.optics.colour.photometric import (
    BALL_EXPONENTS,
    NearLamp,
    PhotometricModel,
    ShadingTerms,
    load_photometric,
)
from sim.optics.render.renderer import TactileRenderer
from tests.sim.optics.analytic_surface import APEX_M, ball_press, camera
from tests.sim.optics.synthetic_presses import press_scene, presses, true_model

TERMS = ShadingTerms(
    lamps=tuple(
        NearLamp(azimuth_rad=azimuth, elevation_rad=0.2, distance=1.5)
        for azimuth in (-1.6, 0.4, 2.5)
    ),
    softness=0.05,
    aspect=0.75,
    crease_limit=1e4,
)


def _random_surface(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    angle, sine = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.0, 0.6, count)
    tilt = np.stack([sine * np.cos(angle), sine * np.sin(angle)])
    return tilt, rng.uniform(-1, 1, (2, count)), rng.uniform(-2e3, 2e3, count)


def test_a_slope_towards_a_lamp_is_lit_and_one_away_from_it_goes_dark() -> None:
    """Lambert's cosine towards the lamp; beyond the terminator nothing more is lost."""
    lamp = NearLamp(azimuth_rad=0.0, elevation_rad=0.2, distance=1e6)
    tilts = np.array([[0.5, -0.5, -0.7], [0.0, 0.0, 0.0]])
    lit = replace(TERMS, lamps=(lamp,), softness=1e-6).values(tilts, 0.0 * tilts, 0.0 * tilts[0])[0]
    expected = math.cos(0.2) * 0.5 + math.sin(0.2) * (math.sqrt(0.75) - 1.0)
    assert lit[0] == pytest.approx(expected, abs=1e-5)
    np.testing.assert_allclose(lit[1:], -math.sin(0.2), atol=1e-5)


def test_lamps_are_found_from_colours_alone() -> None:
    """Three near lamps and a crease come back from noisy samples, whatever stands in a file."""
    tilt, position, curvature = _random_surface(6000)
    rng = np.random.default_rng(1)
    weights = np.zeros((TERMS.count, 3))
    weights[[0, 3, 6], [0, 1, 2]], weights[9] = 120.0, 15.0
    change = TERMS.values(tilt, position, curvature).T @ weights
    samples = PhotometricSamples(
        surface=np.stack([*tilt, np.zeros(6000), curvature])[None],
        position=position,
        change=(change + rng.normal(0.0, 1.0, change.shape)).T,
        weights=np.ones((3, 6000)),
    )
    terms = fit_terms(samples, lamp_count=3, aspect=0.75)
    assert terms.crease_limit == np.abs(curvature).max()
    found = sorted(math.remainder(lamp.azimuth_rad, math.tau) for lamp in terms.lamps)
    np.testing.assert_allclose(found, [-1.6, 0.4, 2.5], atol=0.03)
    np.testing.assert_allclose([lamp.elevation_rad for lamp in terms.lamps], 0.2, atol=0.03)
    model = fit_photometric([samples], exponents=BALL_EXPONENTS, terms=terms)
    zero = np.zeros(6000)
    off = model.evaluate(tilt, position, zero, curvature).T - change
    assert np.sqrt(np.mean(off**2)) < 0.3
    steep = 1.4 * tilt  # beyond what was fitted, where a polynomial alone would run away
    off = model.evaluate(steep, position, zero, curvature).T
    off -= TERMS.values(steep, position, curvature).T @ weights
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_saved_terms_come_back_and_render(tmp_path: Path) -> None:
    """A file keeps all of a model; level gel gives the no-contact frame, bright as it may be."""
    rng = np.random.default_rng(3)
    model = PhotometricModel(
        exponents=BALL_EXPONENTS,
        coefficients=rng.normal(0.0, 5.0, (len(BALL_EXPONENTS), 3)),
        tilt_limit=0.6,
        terms=TERMS,
        term_coefficients=rng.normal(0.0, 20.0, (TERMS.count, 3)),
        response=Response(knee=150.0),
        reference=100.0,
        provenance={"source": "made up"},
    )
    model.save(tmp_path / "model.npz")
    loaded = load_photometric(tmp_path / "model.npz")
    tilt, position, curvature = _random_surface(20)
    probe = tilt, position, np.zeros(20), curvature
    np.testing.assert_allclose(loaded.evaluate(*probe), model.evaluate(*probe), rtol=1e-12)
    for name in ("tilt_limit", "response", "reference", "provenance"):
        assert getattr(loaded, name) == getattr(model, name)
    background = np.linspace(0.0, 255.0, 96 * 128 * 3).reshape(96, 128, 3).astype(np.uint8)
    flat = np.full((96, 128), APEX_M)
    renderer = TactileRenderer(background, flat, loaded, camera())
    np.testing.assert_array_equal(renderer.render(flat), background)
    x, y = camera().pad_grid()
    bowl = ball_press(x, y, ball_radius_m=2.35e-3, contact_radius_m=1.2e-3, tip_z_m=APEX_M - 8e-4)
    assert np.ptp(renderer.render(np.minimum(bowl, APEX_M)).astype(int)) > 20


@given(st.floats(100.0, 254.0), st.floats(0.0, 254.5))
def test_light_shows_as_the_levels_that_it_was_read_from(knee: float, level: float) -> None:
    """Levels to light and back is nothing; the slope is that of the curve."""
    response, levels = Response(knee=knee), np.array([level])
    near = levels < 255.0 - min(0.4, 0.5 * (255.0 - knee))
    light = response.light(levels)
    np.testing.assert_allclose(response.levels(light)[near], levels[near], atol=1e-6)
    rise = response.levels(light + 1e-4) - response.levels(light - 1e-4)
    np.testing.assert_allclose(rise[near] / 2e-4, response.slope(levels)[near], atol=1e-3)


def test_the_last_levels_of_a_shoulder_only_bound_the_light() -> None:
    """A pixel near the end of a compressed range says that the light was at least so bright."""
    levels = np.array([[253, 240, 100]], dtype=np.uint8)
    seen = seen_change(levels, np.full((1, 3), 100.0), Response(knee=200.0))
    assert seen.over.tolist() == [[True, False, False]]
    assert seen.change[0, 2] == 0.0


@pytest.mark.slow
def test_presses_tell_where_the_shoulder_begins() -> None:
    """A knee in the middle of the presses' levels is found, and none where there is none."""
    bright = replace(true_model(), coefficients=4.0 * true_model().coefficients)
    bent = replace(bright, response=Response(knee=205.0))
    shown, _, _ = presses(10, model=bent, seed=4)
    scene = replace(press_scene(), exponents=BALL_EXPONENTS)
    found = calibrate_optics(shown, scene)
    assert found.model.response.knee == pytest.approx(205.0, abs=3.0)
    straight, _, _ = presses(10, model=bright, seed=4)
    found = calibrate_optics(straight, scene)
    assert found.model.response == LINEAR
