"""The renderer of blocks of pixels against its formula written out plainly."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sim.optics.colour.colour_model import LINEAR, Response
from sim.optics.colour.model_terms import (
    BALL_EXPONENTS,
    NearLamp,
    ShadingTerms,
    polynomial_exponents,
)
from sim.optics.colour.photometric import PhotometricModel, normalised_positions
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import Lamp, ShadowCaster
from tests.sim.optics.analytic_surface import APEX_M, ball_press
from tests.sim.optics.plain_shadows import plain_darkening
from tests.sim.optics.surface_tilt import surface_tilt

_TERMS = ShadingTerms(
    lamps=tuple(
        NearLamp(azimuth_rad=azimuth, elevation_rad=0.25, distance=1.6)
        for azimuth in (-1.6, 0.5, 2.6)
    ),
    softness=0.1,
    aspect=0.75,
    crease_limit=3e3,
)
_SHADOWS = ShadowCaster(
    lamps=[
        Lamp(azimuth_rad=azimuth, elevation_rad=0.25, colour=colour)
        for azimuth, colour in (
            (-1.57, (80.0, 9.0, 0.0)),
            (0.5, (0.0, 80.0, 0.0)),
            (2.7, (9.0, 0.0, 80.0)),
        )
    ],
    softness_m=8e-5,
)
_LOW = polynomial_exponents(tilt_degree=2, position_degree=4, indentation_degree=2)


def _camera(width: int, height: int) -> CameraGeometry:
    return CameraGeometry(
        width=width,
        height=height,
        scale_x_m=12e-3 / width,
        scale_y_m=9e-3 / height,
        centre_x_px=(width - 1) / 2,
        centre_y_px=(height - 1) / 2,
    )


def _model(exponents: np.ndarray, terms: ShadingTerms | None) -> PhotometricModel:
    rng = np.random.default_rng(4)
    return PhotometricModel(
        exponents=exponents,
        coefficients=rng.normal(0.0, 30.0, (len(exponents), 3)),
        tilt_limit=0.5,
        indentation_limit_m=6e-4,
        terms=terms,
        term_coefficients=rng.normal(0.0, 25.0, (0 if terms is None else terms.count, 3)),
        response=LINEAR if terms is None else Response(knee=150.0),
        reference=None if terms is None else 110.0,
    )


def _plain_change(
    height: np.ndarray,
    rest: np.ndarray,
    model: PhotometricModel,
    geometry: CameraGeometry,
    samples: int,
    shadows: ShadowCaster | None,
    gain: np.ndarray | None,
) -> np.ndarray:
    """Return the mean change of every sample's light, in double precision."""
    fine = geometry.refined(samples)
    q, p = np.gradient(height, fine.scale_y_m, fine.scale_x_m)
    p, q = (slope / np.sqrt(1.0 + p**2 + q**2) for slope in (p, q))
    bend = np.gradient(p, fine.scale_x_m, axis=1) + np.gradient(q, fine.scale_y_m, axis=0)
    places = normalised_positions(geometry.height, geometry.width).astype(np.float64)
    places = places.reshape(2, geometry.height, geometry.width)
    places = places.repeat(samples, axis=1).repeat(samples, axis=2)
    tilt = np.stack([p.ravel(), q.ravel()])
    change = model.evaluate(tilt, places.reshape(2, -1), (rest - height).ravel(), bend.ravel())
    shape = (3, geometry.height, samples, geometry.width, samples)
    light = change.reshape(shape).mean(axis=(2, 4)).transpose(1, 2, 0)
    if gain is not None:
        light = light * gain
    if shadows is not None:
        dark = plain_darkening(shadows, rest - height, surface_tilt(height, fine), fine)
        light = light + dark.reshape(shape).mean(axis=(2, 4)).transpose(1, 2, 0)
    return light


@pytest.mark.parametrize(("width", "height"), [(128, 96), (83, 61), (15, 20)])
@pytest.mark.parametrize("samples", [1, 2, 3])
@pytest.mark.parametrize(
    ("exponents", "terms", "shadows"), [(BALL_EXPONENTS, _TERMS, _SHADOWS), (_LOW, None, None)]
)
def test_image_is_that_of_the_formula(
    width: int,
    height: int,
    samples: int,
    exponents: np.ndarray,
    terms: ShadingTerms | None,
    shadows: ShadowCaster | None,
) -> None:
    """Level, bent and steep pixels, borders too, agree with every sample's colour to one level."""
    geometry, model = _camera(width, height), _model(exponents, terms)
    x, y = geometry.refined(samples).pad_grid()
    rest = APEX_M - (x**2 + y**2) / 0.3
    press = ball_press(
        x - 1e-3, y, ball_radius_m=2.35e-3, contact_radius_m=1.5e-3, tip_z_m=APEX_M - 8e-4
    )
    loaded = rest - (APEX_M - press)
    background = np.random.default_rng(5).integers(80, 170, (height, width, 3)).astype(np.uint8)
    light = model.response.light(background.astype(np.float64))
    gain = model.gain(light)
    change = _plain_change(loaded, rest, model, geometry, samples, shadows, gain)
    change -= _plain_change(rest, rest, model, geometry, samples, shadows, gain)
    blurred = cv2.GaussianBlur(change, (0, 0), 0.75, borderType=cv2.BORDER_REFLECT_101)
    expected = np.clip(np.floor(model.response.levels(light + blurred) + 0.5), 0, 255)
    renderer = TactileRenderer(
        background, rest, model, geometry, shadows=shadows, samples=samples, blur_px=0.75
    )
    image = renderer.render(loaded)
    apart = np.abs(image.astype(int) - expected)
    assert apart.max() <= 1
    assert np.mean(apart > 0) < 0.02
    np.testing.assert_array_equal(renderer.render(loaded), image)
    np.testing.assert_array_equal(renderer.render(rest), background)
