"""The renderer of blocks of pixels against its formula written out plainly."""

import math

import cv2
import numpy as np
import pytest

from sim.optics.colour.model_interface_and_response import LINEAR, Response
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
from sim.sensor.lamps_and_optics import Lamp, ShadowCaster
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
        Lamp(azimuth_rad=azimuth, elevation_rad=0.25, colour=colour, distance_m=distance)
        for azimuth, colour, distance in (
            (-1.57, (80.0, 9.0, 0.0), None),
            (0.5, (0.0, 80.0, 0.0), 9e-3),
            (2.7, (9.0, 0.0, 80.0), 25e-3),
        )
    ],
    softness_m=8e-5,
    spread=0.1,
)
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
    change = change.reshape(shape)
    if shadows is not None:
        change = change + _plain_darkening(shadows, rest - height, tilt, fine).reshape(shape)
    return change.mean(axis=(2, 4)).transpose(1, 2, 0) * gain


def _plain_darkening(
    shadows: ShadowCaster, bulge: np.ndarray, tilt: np.ndarray, geometry: CameraGeometry
) -> np.ndarray:
    """Return the light taken away [grey levels, not positive], shape [3, height, width]."""
    taken = np.zeros((3, *bulge.shape))
    normal = np.stack([*tilt, np.sqrt(1 - tilt[0] ** 2 - tilt[1] ** 2)])
    for lamp in shadows.lamps:
        hidden, towards = _hidden(bulge, lamp, shadows, geometry)
        facing = np.maximum((towards * normal).sum(axis=0), 0.0)
        taken -= np.array(lamp.colour)[:, None, None] * hidden * facing
    return taken


def _hidden(
    bulge: np.ndarray, lamp: Lamp, shadows: ShadowCaster, geometry: CameraGeometry
) -> tuple[np.ndarray, np.ndarray]:
    """Return how much of a lamp pixels do not see, and the direction to it, unit vectors.

    On each of the rays that part from the lamp, the gel that is seen from there under the steepest
    angle so far casts the shadow; between rays shadows are interpolated linearly.
    """
    scale = np.array([geometry.scale_x_m, geometry.scale_y_m])
    size = np.array(bulge.shape[::-1])
    away = lamp.distance_m or 200.0 * ((size - 1) * scale).max()
    way = np.array([math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)])
    foot, height = 0.5 * (size - 1) * scale + away * way, away * math.tan(lamp.elevation_rad)
    y, x = np.mgrid[: size[1], : size[0]] * scale[::-1, None, None]
    to_lamp = np.stack([foot[0] - x, foot[1] - y, np.full(x.shape, height)])
    towards = to_lamp / np.linalg.norm(to_lamp, axis=0)
    beside = np.maximum(-foot, foot - (size - 1) * scale)
    along, main, side = (bulge.T, 0, 1) if beside[0] >= beside[1] else (bulge, 1, 0)
    steps = np.abs(np.arange(size[main]) * scale[main] - foot[main])
    order = np.argsort(steps)
    across = np.arange(size[side]) * scale[side] - foot[side]
    slopes = across[[0, -1]][:, None] / steps[order[[0, -1]]]
    apart = scale[side] / steps[order[len(order) // 2]]
    rays = slopes.min() + apart * np.arange(math.ceil(np.ptp(slopes) / apart) + 2)
    steepest, cut = np.full(len(rays), -np.inf), np.zeros(len(rays))
    hidden = np.empty(along.shape)
    for step in order:
        padded = [0.0, *along[step], 0.0]
        ends = [2 * across[0] - across[1], *across, 2 * across[-1] - across[-2]]
        met = np.interp(rays * steps[step], ends, padded)
        over = height + steps[step] * steepest - met
        wide = shadows.spread * (steps[step] - cut) * np.hypot(1.0, rays)
        share = np.clip(over / (shadows.softness_m + wide), 0.0, 1.0)
        hidden[step] = np.interp(across / steps[step], rays, share)
        slope = (met - height) / steps[step]
        cut = np.where(slope > steepest, steps[step], cut)
        steepest = np.maximum(slope, steepest)
    return hidden.T if main == 0 else hidden, towards


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
    for dents in ([0.0 * dent, dent], [dent, 0.0 * dent]):  # of the first, nothing is left
        room.assign(np.stack(dents).astype(np.float32))
        loaded, unloaded = render().numpy()
    apart = np.abs(loaded.astype(int) - expected)
    assert apart.max() <= 1
    assert np.mean(apart > 0) < 0.02
    np.testing.assert_array_equal(unloaded, background)
