"""The renderer of blocks of pixels against its formula written out plainly."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from sim.optics.colour.colour_model import LINEAR, Response
from sim.optics.colour.photometric import (
    BALL_EXPONENTS,
    NearLamp,
    PhotometricModel,
    ShadingTerms,
    normalised_positions,
    polynomial_exponents,
)
from sim.optics.render import renderer
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import Lamp, ShadowCaster
from tests.sim.optics.analytic_surface import APEX_M, ball_press, surface_tilt

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
_NOTHING_M = -1.0
_LOW = polynomial_exponents(tilt_degree=2, position_degree=4, indentation_degree=2)


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
    gain: np.ndarray,
) -> np.ndarray:
    """Return the mean change of every sample's light, in double precision."""
    fine = geometry.refined(samples)
    tilt = surface_tilt(height, fine)
    bend = np.gradient(tilt[0], fine.scale_x_m, axis=1)
    bend += np.gradient(tilt[1], fine.scale_y_m, axis=0)
    places = normalised_positions(geometry.height, geometry.width).astype(np.float64)
    places = places.reshape(2, geometry.height, geometry.width)
    places = places.repeat(samples, axis=1).repeat(samples, axis=2).reshape(2, -1)
    change = model.evaluate(tilt.reshape(2, -1), places, (rest - height).ravel(), bend.ravel())
    shape = (3, geometry.height, samples, geometry.width, samples)
    light = change.reshape(shape).mean(axis=(2, 4)).transpose(1, 2, 0) * gain
    if shadows is not None:
        dark = _plain_darkening(shadows, rest - height, tilt, fine)
        light = light + dark.reshape(shape).mean(axis=(2, 4)).transpose(1, 2, 0)
    return light


def _plain_darkening(
    shadows: ShadowCaster, bulge: np.ndarray, tilt: np.ndarray, geometry: CameraGeometry
) -> np.ndarray:
    """Return the light taken away [grey levels, not positive], shape [3, height, width]."""
    taken = np.zeros((3, *bulge.shape))
    for lamp in shadows.lamps:
        over = _rise_over(bulge, lamp, geometry)
        along, across, up = lamp.towards
        facing = along * tilt[0] + across * tilt[1] + up * np.sqrt(1 - tilt[0] ** 2 - tilt[1] ** 2)
        share = np.clip(over / shadows.softness_m, 0.0, 1.0) * np.maximum(facing, 0.0)
        taken -= np.array(lamp.colour)[:, None, None] * share
    return taken


def _rise_over(bulge: np.ndarray, lamp: Lamp, geometry: CameraGeometry) -> np.ndarray:
    """Return how far the gel rises over each pixel's ray at most [m], shape [height, width]."""
    right, down = math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)
    turned = abs(right) >= abs(down)
    ahead, aside = (right, down) if turned else (down, right)
    heights = bulge.T if turned else bulge
    heights = heights if ahead > 0.0 else heights[::-1]
    steps, across = heights.shape
    shift = aside / abs(ahead)
    rise_m = math.tan(lamp.elevation_rad) * geometry.mean_scale_m * math.hypot(1.0, shift)
    margin = math.ceil((steps - 1) * abs(shift))
    offset = margin + 1 if shift > 0.0 else 1
    highest = np.full(across + margin + 1, _NOTHING_M)
    rays = np.arange(len(highest))
    over = np.empty_like(heights)
    for step in reversed(range(steps)):
        place = step * shift - offset
        whole, sunk = math.floor(place), step * rise_m
        part = place - whole
        between = np.arange(across) - whole
        seen = part * highest[between - 1] + (1.0 - part) * highest[between]
        over[step] = seen + sunk - heights[step]
        met = np.interp(rays + place, np.arange(-1, across + 1), [0.0, *heights[step], 0.0])
        highest = np.maximum(highest, met - sunk)
    over = over if ahead > 0.0 else over[::-1]
    return over.T if turned else over


@pytest.mark.parametrize(
    ("width", "height", "samples"), [(128, 96, 1), (83, 61, 2), (15, 20, 3), (15, 20, 1)]
)
@pytest.mark.parametrize("lanes", ["processor", "gpu"])
@pytest.mark.parametrize(
    ("exponents", "terms", "shadows", "blur_px"),
    [(BALL_EXPONENTS, _TERMS, _SHADOWS, 0.75), (_LOW, None, None, 0.75), (_LOW, None, _SHADOWS, 0)],
)
def test_images_are_those_of_the_formula(
    monkeypatch: pytest.MonkeyPatch,
    width: int,
    height: int,
    samples: int,
    lanes: str,
    exponents: np.ndarray,
    terms: ShadingTerms | None,
    shadows: ShadowCaster | None,
    blur_px: float,
) -> None:
    """Level, bent and steep pixels, borders too, agree with every sample's colour to one level.

    Two images at once, in wide blocks or in blocks of one pixel, as a GPU has them; unloaded gel
    gives the no-contact frame.
    """
    if lanes == "gpu":
        monkeypatch.setattr(renderer, "CPU_LANES", renderer.GPU_LANES)
    geometry = CameraGeometry.centred(
        width, height, scale_x_m=12e-3 / width, scale_y_m=9e-3 / height
    )
    model = _model(exponents, terms)
    x, y = geometry.refined(samples).pad_grid()
    rest = APEX_M - (x**2 + y**2) / 0.3
    dent = APEX_M - ball_press(
        x - 1e-3, y, ball_radius_m=2.35e-3, contact_radius_m=1.5e-3, tip_z_m=APEX_M - 8e-4
    )
    background = np.random.default_rng(5).integers(80, 170, (height, width, 3)).astype(np.uint8)
    light = model.response.light(background.astype(np.float64))
    gain = model.gain(light)
    change = _plain_change(rest - dent, rest, model, geometry, samples, shadows, gain)
    change -= _plain_change(rest, rest, model, geometry, samples, shadows, gain)
    if blur_px:
        change = cv2.GaussianBlur(change, (0, 0), blur_px, borderType=cv2.BORDER_REFLECT_101)
    expected = np.clip(np.floor(model.response.levels(light + change) + 0.5), 0, 255)
    room, render = TactileRenderer(
        background, rest, model, geometry, shadows=shadows, samples=samples, blur_px=blur_px
    ).prepared(2)
    room.assign(np.stack([dent, 0.0 * dent]).astype(np.float32))
    loaded, unloaded = render().numpy()
    apart = np.abs(loaded.astype(int) - expected)
    assert apart.max() <= 1
    assert np.mean(apart > 0) < 0.02
    np.testing.assert_array_equal(unloaded, background)
