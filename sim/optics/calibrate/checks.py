"""What is wrong with a set of ball presses: too few, saturated, impossible or contradictory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.optics.calibrate.cross_validation import (
    CheckScores,
    RenderedPress,
    contact_mask,
    held_out_errors,
)
from sim.optics.calibrate.presses.ball_press import BallPress, Circle
from sim.optics.calibrate.presses.scene import PressScene, exposed
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import ConfigError

FEWEST = 5
_FEW = 14
_SATURATED_WARN = 0.01
_SATURATED_REFUSE = 0.6
_ODD_ONE_OUT = 2.5
_FAR_NUDGE = 0.25
_CONTRADICTORY_R2 = 0.5
_FEW_SLOPES = 0.9
_LITTLE_OF_THE_IMAGE = 0.5
_BINS = 24
_LISTED = 6  # images that a warning names


def check_before(
    presses: Sequence[BallPress], geometry: CameraGeometry, *, ball_radius_m: float
) -> list[str]:
    """Look at presses before anything is fitted to them, and return warnings, one a line.

    Raises:
        ConfigError: Most are saturated, or a circle is larger than the ball.
    """
    for press in presses:
        radius_m = press.circle.radius_px * geometry.mean_scale_m
        if radius_m >= ball_radius_m:
            raise ConfigError(
                f"{press.name}: a contact of radius {radius_m * 1e3:.2f} mm cannot be of a ball of "
                f"diameter {ball_radius_m * 2e3:.2f} mm",
                remedy="correct the circle's radius_px, --scale or --ball-diameter",
            )
    warnings = []
    if len(presses) < _FEW:
        warnings.append(
            f"only {len(presses)} presses: {_FEW} or more, all over the image, are wanted"
        )
    shares = {press.name: _saturated_share(press) for press in presses}
    bad = [name for name, share in shares.items() if share > _SATURATED_WARN]
    worst = float(np.median(list(shares.values())))
    if worst > _SATURATED_REFUSE:
        raise ConfigError(
            f"half of the presses have at least {worst:.0%} of their contact at the end of the "
            "camera's range: its colour is lost",
            remedy="lower exposure or gain, switch automatic exposure off, and press again",
        )
    if bad:
        rest = f" and {len(bad) - _LISTED} more" if len(bad) > _LISTED else ""
        warnings.append(
            f"saturated contacts (up to {max(shares.values()):.0%} of the pixels at the end of the "
            f"camera's range): {', '.join(bad[:_LISTED])}{rest}; lower exposure or gain"
        )
    return warnings


def check_coverage(coverage: SlopeCoverage) -> list[str]:
    """Warn where a model is used on slopes or in places that it was not fitted to."""
    warnings = []
    if coverage.slopes_seen_share < _FEW_SLOPES:
        warnings.append(
            f"the presses show {coverage.slopes_seen_share:.0%} of the slopes up to a sine of "
            f"{coverage.tilt_limit:.2f}; press the ball deeper and in more places"
        )
    if coverage.image_share < _LITTLE_OF_THE_IMAGE:
        warnings.append(
            f"the presses lie on {coverage.image_share:.0%} of the image; colours elsewhere are "
            "extrapolated"
        )
    return warnings


def check_after(
    scores: CheckScores, held_out: Sequence[RenderedPress], scene: PressScene
) -> list[str]:
    """Look at what cross-validation says of the presses, and return warnings, one a line.

    Raises:
        ConfigError: The presses contradict each other, so that none can be predicted by the rest.
    """
    if scores.r2 < _CONTRADICTORY_R2:
        raise ConfigError(
            f"the presses contradict each other: held out, R2 is {scores.r2:.2f} inside the "
            f"contact (the no-contact frame's is {scores.r2_no_contact:.2f})",
            remedy="check that --background is of the same sensor, lights and camera mode as the "
            "presses, and that --circles, --scale and --ball-diameter are theirs",
        )
    errors = held_out_errors(held_out, scene)
    usual = float(np.median(errors))
    warnings = [
        f"{item.press.name} contradicts the other presses: held out, its mean error is "
        f"{error:.1f} grey levels, theirs {usual:.1f}"
        for item, error in zip(held_out, errors, strict=True)
        if error > _ODD_ONE_OUT * usual
    ]
    for item in held_out:
        label, found = item.press.circle, item.circle
        move = max(map(abs, found.moved_from(label)))
        if move > _FAR_NUDGE * label.radius_px:
            warnings.append(
                f"{item.press.name}: the image wants its circle {move:.0f} px off the label "
                f"({found.x_px:.0f}, {found.y_px:.0f}, radius {found.radius_px:.0f} px)"
            )
    return warnings


def _saturated_share(press: BallPress) -> float:
    inside = press.image[contact_mask(press.circle, *press.image.shape[:2])]
    return float(np.mean(~exposed(inside).all(axis=-1))) if inside.size else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SlopeCoverage:
    """How often each slope was seen.

    Attributes:
        slopes_seen_share: Part of the disc of tilts up to the limit that at least one press shows.
        image_share: Part of the image that lies in at least one contact.
        tilt_edges: Borders of the bins of tilt (sine of the surface's angle), shape [_BINS + 1].
        presses_seen: Presses that show a tilt, by tilt along rows and columns, [_BINS, _BINS].
    """

    tilt_limit: float
    slopes_seen_share: float
    image_share: float
    tilt_edges: FloatArray
    presses_seen: Int64Array


def slope_coverage(circles: Sequence[Circle], scene: PressScene) -> SlopeCoverage:
    """Count slopes and places inside the contacts; at least one circle."""
    height, width = scene.background.shape[:2]
    rows, columns = (grid.ravel() for grid in np.indices((height, width)))
    inside = []
    touched = np.zeros(len(rows), dtype=np.bool_)
    for circle in circles:
        near = circle.distance(columns, rows) <= circle.radius_px
        inside.append(scene.surface(circle, columns[near], rows[near]).tilt)
        touched |= near
    limit = max(float(np.hypot(*tilt).max(initial=0.0)) for tilt in inside)
    edges = np.linspace(-limit, limit, _BINS + 1)
    shown = [np.histogram2d(tilt[1], tilt[0], bins=(edges, edges))[0] > 0 for tilt in inside]
    seen = np.stack(shown).sum(axis=0, dtype=np.int64)
    middle = 0.5 * (edges[1:] + edges[:-1])
    disc = np.hypot(*np.meshgrid(middle, middle)) <= limit
    return SlopeCoverage(
        tilt_edges=edges,
        presses_seen=seen,
        tilt_limit=limit,
        slopes_seen_share=float(np.mean(seen[disc] > 0)) if limit > 0.0 else 0.0,
        image_share=float(touched.mean()),
    )
