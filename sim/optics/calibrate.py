"""Calibration of the photometric model from ball presses, with cross-validation."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.optics.ball_press import BallPress, Circle, check_sizes
from sim.optics.photometric import PhotometricModel
from sim.optics.photometric_fit import BALL_EXPONENTS, PhotometricSamples, fit_photometric
from sim.optics.press_scene import PressScene
from sim.optics.press_scores import PressScores, RenderedPress, score_presses
from tacauchy_rig.errors import ConfigError

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What a set of presses gave.

    Attributes:
        model: Photometric model.
        circles: Nudged circles, in the order of the presses.
        lights: Offset of each frame's light [grey levels], shape [press_count, 3].
    """

    model: PhotometricModel
    circles: tuple[Circle, ...]
    lights: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckScores:
    """Scores of presses that the model has not seen.

    Attributes:
        raw: Labelled circles, frames as they came.
        light_matched: Labelled circles, light offset taken off.
        nudged: Nudged circles, light offset taken off.
        light_offset_rms: Root mean square of the offsets taken off [grey levels].
        nudge_rms_px: Root mean square of the circles' moves in x, y and radius [px].
    """

    raw: PressScores
    light_matched: PressScores
    nudged: PressScores
    light_offset_rms: float
    nudge_rms_px: float


def calibrate_optics(
    presses: Sequence[BallPress],
    scene: PressScene,
    *,
    exponents: IntArray = BALL_EXPONENTS,
    rounds: int = 3,
) -> Calibration:
    """Fit model, circles and light by turns.

    Args:
        presses: Images with labelled circles.
        scene: Camera, no-contact frame and gel profile.
        exponents: Terms of the model.
        rounds: How often circles are nudged and the model is fitted again.

    Raises:
        ConfigError: There is no press, or one has another size than the no-contact frame.
    """
    if not presses:
        raise ConfigError("no ball press to calibrate from", remedy="give at least one, better 20")
    check_sizes(presses, scene.background.astype(np.uint8))
    circles = [press.circle for press in presses]
    lights = [scene.light_offset(p, c, None) for p, c in zip(presses, circles, strict=True)]
    model = _fit(presses, circles, lights, scene, exponents)
    for turn in range(rounds):
        for i, press in enumerate(presses):
            lights[i] = scene.light_offset(press, circles[i], model)
            circles[i] = scene.nudged(press, model, lights[i])
        model = _fit(presses, circles, lights, scene, exponents)
        log.debug("calibration round %d of %d done", turn + 1, rounds)
    return Calibration(model=model, circles=tuple(circles), lights=np.array(lights))


def render_presses(
    presses: Sequence[BallPress], model: PhotometricModel, scene: PressScene, *, nudge: bool
) -> list[RenderedPress]:
    """Render presses that the model need not have seen, where labels or nudged circles say."""
    rendered = []
    height, width = scene.background.shape[:2]
    rows, columns = (grid.ravel().astype(np.float64) for grid in np.mgrid[:height, :width])
    for press in presses:
        circle, light = press.circle, scene.light_offset(press, press.circle, model)
        if nudge:
            circle = scene.nudged(press, model, light)
            light = scene.light_offset(press, circle, model)
        change = scene.predict(model, circle, columns, rows).reshape(height, width, 3)
        rendered.append(
            RenderedPress(
                press=press, rendered=scene.background + change, light=light, circle=circle
            )
        )
    return rendered


def check_presses(
    presses: Sequence[BallPress], model: PhotometricModel, scene: PressScene
) -> CheckScores:
    """Score a model on presses it has not seen."""
    labelled = render_presses(presses, model, scene, nudge=False)
    return _scores(labelled, render_presses(presses, model, scene, nudge=True), scene)


def cross_validate(
    presses: Sequence[BallPress],
    scene: PressScene,
    *,
    folds: int = 7,
    exponents: IntArray = BALL_EXPONENTS,
) -> tuple[CheckScores, list[RenderedPress]]:
    """Fit on all folds but one and score that one, for each; press i is in fold i modulo folds.

    Returns:
        Scores over all presses, and each press as rendered by the model that had not seen it
        (nudged circle), in fold order.

    Raises:
        ConfigError: There are fewer presses than folds, or fewer than two folds.
    """
    if not 2 <= folds <= len(presses):
        raise ConfigError(
            f"{len(presses)} presses cannot be cross-validated in {folds} folds",
            remedy="give at least as many presses as folds, and at least two folds",
        )
    labelled: list[RenderedPress] = []
    nudged: list[RenderedPress] = []
    for fold in range(folds):
        seen = [press for i, press in enumerate(presses) if i % folds != fold]
        held_out = presses[fold::folds]
        model = calibrate_optics(seen, scene, exponents=exponents).model
        labelled += render_presses(held_out, model, scene, nudge=False)
        nudged += render_presses(held_out, model, scene, nudge=True)
    return _scores(labelled, nudged, scene), nudged


def _scores(
    labelled: list[RenderedPress], nudged: list[RenderedPress], scene: PressScene
) -> CheckScores:
    moves = [
        (
            a.circle.x_px - b.circle.x_px,
            a.circle.y_px - b.circle.y_px,
            a.circle.radius_px - b.circle.radius_px,
        )
        for a, b in zip(nudged, labelled, strict=True)
    ]
    return CheckScores(
        raw=score_presses(labelled, scene.background, light_matched=False),
        light_matched=score_presses(labelled, scene.background, light_matched=True),
        nudged=score_presses(nudged, scene.background, light_matched=True),
        light_offset_rms=float(np.sqrt(np.mean([item.light**2 for item in nudged]))),
        nudge_rms_px=float(np.sqrt(np.mean(np.square(moves)))),
    )


def _fit(
    presses: Sequence[BallPress],
    circles: Sequence[Circle],
    lights: Sequence[FloatArray],
    scene: PressScene,
    exponents: IntArray,
) -> PhotometricModel:
    parts = [
        scene.samples(press, circle, light)
        for press, circle, light in zip(presses, circles, lights, strict=True)
    ]
    samples = PhotometricSamples(
        tilt=np.concatenate([part.tilt for part in parts], axis=1),
        position=np.concatenate([part.position for part in parts], axis=1),
        indentation_m=np.concatenate([part.indentation_m for part in parts]),
        change=np.concatenate([part.change for part in parts]),
    )
    model = fit_photometric(samples, exponents=exponents)
    return replace(
        model, provenance={"press_count": len(presses), "pixel_count": len(samples.change)}
    )
