"""Batches of images against the one-by-one renderer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sim.optics.colour.colour_model import LINEAR, Response
from sim.optics.colour.model_terms import BALL_EXPONENTS, NearLamp, ShadingTerms
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.render import renderer
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.optics import Lamp, ShadowCaster
from tests.sim.optics.analytic_surface import APEX_M, ball_press, camera

_LAMPS = [
    Lamp(azimuth_rad=azimuth, elevation_rad=0.25, colour=colour)
    for azimuth, colour in ((-1.57, (80.0, 9.0, 0.0)), (0.5, (0.0, 80.0, 0.0)), (2.7, (9.0, 0, 80)))
]


_TERMS = ShadingTerms(
    lamps=tuple(
        NearLamp(azimuth_rad=azimuth, elevation_rad=0.3, distance=1.6) for azimuth in (-1.6, 0.5)
    ),
    softness=0.1,
    aspect=0.75,
    crease_limit=3e3,
)


_SHADOWS = ShadowCaster(lamps=_LAMPS, softness_m=8e-5)


@pytest.mark.parametrize(
    ("samples", "blur_px", "terms", "shadows"),
    [  # every pair of settings once
        (1, 0.0, None, None),
        (1, 0.7, _TERMS, _SHADOWS),
        (2, 0.0, _TERMS, _SHADOWS),
        (2, 0.7, None, _SHADOWS),
        (2, 0.7, _TERMS, None),
        (1, 0.0, None, _SHADOWS),
    ],
)
def test_batch_gives_the_single_images(
    monkeypatch: pytest.MonkeyPatch,
    samples: int,
    blur_px: float,
    shadows: ShadowCaster | None,
    terms: ShadingTerms | None,
) -> None:
    """Blocks of one pixel, as a GPU has them, give a batch the images of wide ones to one level."""
    rng = np.random.default_rng(2)
    model = PhotometricModel(
        exponents=BALL_EXPONENTS,
        coefficients=rng.normal(0.0, 25.0, (len(BALL_EXPONENTS), 3)),
        tilt_limit=0.5,
        indentation_limit_m=6e-4,
        terms=terms,
        term_coefficients=rng.normal(0.0, 25.0, (0 if terms is None else terms.count, 3)),
        reference=None if terms is None else 110.0,
        response=LINEAR if terms is None else Response(knee=170.0),
    )
    background = rng.integers(80, 170, (96, 128, 3)).astype(np.uint8)
    x, y = camera().refined(samples).pad_grid()
    rest = APEX_M - (x**2 + y**2) / 0.3
    dents = np.stack(
        [
            np.zeros_like(x),
            *(
                APEX_M - ball_press(
                    x - 1e-3, y, ball_radius_m=2.35e-3, contact_radius_m=a, tip_z_m=APEX_M - d
                )
                for a, d in ((0.8e-3, 3e-4), (1.5e-3, 8e-4))
            ),
        ]
    )  # fmt: skip
    look: Any = {"samples": samples, "blur_px": blur_px, "shadows": shadows}
    single = TactileRenderer(background, rest, model, camera(), **look)
    with monkeypatch.context() as context:
        context.setattr(renderer, "CPU_LANES", renderer.GPU_LANES)
        room, render = TactileRenderer(background, rest, model, camera(), **look).prepared(3)
    room.assign(dents.astype(np.float32))
    batch = render()
    for image, dent in zip(batch.numpy(), dents, strict=True):
        apart = np.abs(image.astype(int) - single.render(rest - dent).astype(int))
        assert apart.max() <= 1
        assert np.mean(apart > 0) < 0.02
    np.testing.assert_array_equal(batch.numpy()[0], background)
