"""Scores of a calibration on presses that it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.optics.calibrate.colours import Calibration
from sim.optics.calibrate.press_image import press_image, without_shadows
from sim.optics.calibrate.presses.ball_press import BallPress, check_presses_fit
from sim.optics.calibrate.presses.samples import PressScene
from sim.optics.calibrate.presses.scores import PressScores, RenderedPress, score_presses
from tacauchy_rig.errors import ConfigError

_NUDGES = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckScores:
    """Scores of presses that the model has not seen.

    Attributes:
        raw: Rendered at the labelled circles, against the frames as they came.
        light_matched: Labelled circles, with each frame's light as estimated outside the contact.
        nudged: Circles nudged to the image, with each frame's light.
        light_rms: Root mean square of the level of that light [grey levels].
        nudge_rms_px: Root mean square of the circles' moves in x, y and radius [px].
    """

    raw: PressScores
    light_matched: PressScores
    nudged: PressScores
    light_rms: float
    nudge_rms_px: float

    def as_json(self) -> dict[str, Any]:
        """Return the nudged scores at the top, the others below them, as plain JSON values."""
        return {
            **self.nudged.as_json(),
            "as_labelled": self.light_matched.as_json(),
            "as_labelled_frames_as_they_came": self.raw.as_json(),
            "light_rms_levels": self.light_rms,
            "nudge_rms_px": self.nudge_rms_px,
        }


def render_presses(
    presses: Sequence[BallPress], calibration: Calibration, *, nudge: bool
) -> list[RenderedPress]:
    """Render presses that the model need not have seen, where labels or nudged circles say."""
    return [_rendered(press, calibration, nudge=nudge) for press in presses]


def _rendered(press: BallPress, calibration: Calibration, *, nudge: bool) -> RenderedPress:
    model, scene, circle = calibration.model, calibration.scene, press.circle
    lit = without_shadows(press, circle, scene, calibration.shadows)
    light = scene.light(lit, circle, model)
    for _ in range(_NUDGES if nudge else 0):
        circle = scene.nudged(lit, model, light)
        lit = without_shadows(press, circle, scene, calibration.shadows)
        light = scene.light(lit, circle, model)
    image = press_image(calibration, circle)
    return RenderedPress(press=press, rendered=image, light=light, circle=circle)


def check_presses(
    presses: Sequence[BallPress], calibration: Calibration, scene: PressScene
) -> tuple[CheckScores, list[RenderedPress]]:
    """Score a calibration on presses that it has not seen.

    Args:
        presses: With labelled circles.
        calibration: From other presses.
        scene: With the no-contact frame that the scores are compared with.

    Returns:
        Scores, and each press as rendered (nudged circle).

    Raises:
        ConfigError: A press has another size than the no-contact frame.
    """
    check_presses_fit(presses, scene.background.astype(np.uint8))
    labelled = render_presses(presses, calibration, nudge=False)
    nudged = render_presses(presses, calibration, nudge=True)
    return _scores(labelled, nudged, scene), nudged


def cross_validate(
    presses: Sequence[BallPress],
    scene: PressScene,
    *,
    fit: Callable[[Sequence[BallPress]], Calibration],
    folds: int = 7,
) -> tuple[CheckScores, list[RenderedPress]]:
    """Fit on all folds but one and score that one, for each; press i is in fold i modulo folds.

    Args:
        presses: With labelled circles.
        scene: With the no-contact frame that the scores are compared with.
        fit: Makes a calibration of some presses.
        folds: How many.

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
        calibration = fit(seen)
        labelled += render_presses(held_out, calibration, nudge=False)
        nudged += render_presses(held_out, calibration, nudge=True)
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
        raw=score_presses(labelled, scene, light_matched=False),
        light_matched=score_presses(labelled, scene, light_matched=True),
        nudged=score_presses(nudged, scene, light_matched=True),
        light_rms=float(np.sqrt(np.mean([item.light[0] ** 2 for item in nudged]))),
        nudge_rms_px=float(np.sqrt(np.mean(np.square(moves)))),
    )
