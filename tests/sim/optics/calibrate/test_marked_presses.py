"""Ball presses into a gel with markers: their motion, what they hide, and wrong labels."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from sim.optics.calibrate.ball_press import BallPress
from sim.optics.calibrate.colours import Calibration
from sim.optics.calibrate.marker_motion import ORTHOGRAPHIC, GelMotion, MotionModel, fit_motions
from sim.optics.calibrate.optics_fit import gel_motion, press_image
from sim.optics.calibrate.press_scene import PressScene, wrong_label
from sim.optics.markers.printed_markers import find_markers
from tests.sim.optics.synthetic_presses import press_scene, presses, true_model

TRUE = MotionModel(per_distance=40.0, slide=0.7)
BALL_RADIUS_M = 2.35e-3
_FOUND = r"contact at (\d+), (\d+), .* explains (\d+)% .* the label (\d+)%"


def _marked_scene() -> PressScene:
    """Print irregular dots over the frame."""
    scene, rng = press_scene(), np.random.default_rng(8)
    frame = scene.background.copy()
    rows, columns = np.mgrid[: frame.shape[0], : frame.shape[1]]
    for y in range(10, 150, 18):
        for x in range(9, 180, 18):
            at, radius = rng.uniform(-3, 3, 2) + np.array([x, y]), rng.uniform(2.5, 4.0)
            cover = np.clip(radius - np.hypot(columns - at[0], rows - at[1]) + 0.5, 0.0, 1.0)
            frame += cover[..., None] * ((30.0, 34.0, 28.0) - frame)
    markers = find_markers(np.rint(frame).astype(np.uint8))
    assert markers is not None
    return replace(scene, markers=markers, background=markers.bare.astype(np.float64))


def _calibration(scene: PressScene, motion: MotionModel) -> Calibration:
    return Calibration(
        model=true_model(), scene=scene, circles=(), lights=np.zeros((0, 3, 3)), motion=motion
    )


def _pressed(scene: PressScene, count: int) -> tuple[list[BallPress], list[GelMotion]]:
    """Render presses that take the gel along, over images that drift."""
    rng, plain = np.random.default_rng(3), presses(count, noise=0.0)[0]
    model = _calibration(scene, TRUE)
    made, motions = [], []
    for press in plain:
        motion = GelMotion(
            own_px=rng.normal(0.0, 1.0, 8) * ([1.5] * 2 + [0.4] * 6),
            error_px=np.zeros(0),
            under=np.zeros(0, dtype=np.bool_),
        )
        image = press_image(model, press.circle, motion) + rng.normal(0.0, 1.0, (150, 180, 3))
        shown = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        made.append(scene.followed(replace(press, image=shown)))
        motions.append(motion)
    return made, motions


def test_the_motion_of_markers_is_found() -> None:
    """Distance, sliding and each press's own motion come back from tracked markers."""
    scene = _marked_scene()
    made, motions = _pressed(scene, 6)
    tracks = [press.tracks for press in made if press.tracks is not None]
    circles = [press.circle for press in made]
    found, own = fit_motions(tracks, circles, scene.profile, scene.geometry)
    assert found.per_distance == pytest.approx(TRUE.per_distance, rel=0.2)
    for each, true, press in zip(own, motions, made, strict=True):
        assert np.median(each.error_px) < 0.1
        fields = [
            gel_motion(_calibration(scene, by), press.circle, motion)
            for by, motion in ((found, each), (TRUE, true))
        ]
        assert np.median(np.linalg.norm(fields[0] - fields[1], axis=0)) < 0.1


def test_markers_hide_the_gel_where_they_are() -> None:
    """What a press does not show of the gel are its markers, before and after, and no more."""
    scene = _marked_scene()
    made, _ = _pressed(scene, 2)
    for press in made:
        bare = _calibration(replace(scene, markers=None), ORTHOGRAPHIC)
        off = np.abs(press.image - press_image(bare, press.circle))
        assert off[press.shown].max() < 16.0
        assert press.shown.mean() > 0.4


def test_a_wrong_label_is_named_with_evidence() -> None:
    """A circle beside the contact is contradicted by its image; right ones are not."""
    scene = _marked_scene()
    press = _pressed(scene, 1)[0][0]
    assert wrong_label(press, scene, ball_radius_m=BALL_RADIUS_M) is None
    label = replace(press.circle, x_px=press.circle.x_px + 45.0)
    wrong = wrong_label(replace(press, circle=label), scene, ball_radius_m=BALL_RADIUS_M)
    assert wrong is not None
    assert "0000.png was left out: its label says column" in wrong
    x, y, explained, as_labelled = map(float, re.findall(_FOUND, wrong)[0])
    assert press.circle.distance(np.float64(x), np.float64(y)) < 4.0
    assert explained > 60 > 30 > as_labelled
