"""Ball presses as a calibration renders them, beside what a replay makes of the same surface."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.colours import Calibration
from sim.optics.calibrate.optics_fit import press_image, without_shadows
from sim.optics.colour.colour_model import Response
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.optics import Lamp, ShadowCaster
from tests.sim.optics.synthetic_presses import press_scene, true_model

CIRCLE = Circle(x_px=92.0, y_px=71.0, radius_px=18.0)
SHADOWS = ShadowCaster(
    lamps=[Lamp(azimuth_rad=0.7, elevation_rad=math.radians(12.0), colour=(60.0, 20.0, 10.0))],
    softness_m=8e-5,
)


def _calibration(**changed: object) -> Calibration:
    model = replace(true_model(), response=Response(knee=180.0), reference=128.0)
    found = Calibration(
        model=model, scene=press_scene(), circles=(CIRCLE,), lights=np.zeros((1, 3, 3))
    )
    return replace(found, **changed)


@pytest.mark.parametrize("shadows", [None, SHADOWS])
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
    image = press_image(replace(bare, shadows=SHADOWS), CIRCLE)
    seen = BallPress(
        name="press.png", image=np.clip(np.rint(image), 0, 255).astype(np.uint8), circle=CIRCLE
    )
    lit = without_shadows(seen, CIRCLE, bare.scene, SHADOWS)
    plain = press_image(bare, CIRCLE)
    inside = (image > 1.0) & (image < 254.0)
    assert np.abs(lit.image - plain)[inside].max() <= 1.0
    assert without_shadows(seen, CIRCLE, bare.scene, None) is seen
