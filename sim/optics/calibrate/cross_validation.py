"""Scores of a calibration on ball presses that it has not seen, beside the no-contact frame's.

Scores are of the labelled contact and a square crop around it, on colour images. Light-matched ones
first add the frame's own light, as estimated outside the contact, to rendering and no-contact frame
alike. SSIM is scikit-image's with its uniform 7 x 7 window, averaged over channels.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import cv2
import numpy as np
from skimage.metrics import structural_similarity

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.circle_and_light import LARGEST, PlacedPress, PressScene, exposed
from sim.optics.calibrate.colour_fit import Calibration
from sim.optics.calibrate.gel_profile import fit_motions
from sim.optics.calibrate.shadow_blur_fit import press_image, without_shadows
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import AnyArray, Float32Array, FloatArray, ImageArray, Int64Array
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.time_limit_and_progress import doing

_NUDGES = 2
CROP_SHARE = 0.375  # of the image's width, the side of the square that SSIM is of: 120 px of 320
_RING = (1.1, 2.2)  # radii of a contact, between which skirt and shadows are scored by themselves
_SSIM = partial(structural_similarity, channel_axis=2, data_range=255.0)
FEWEST, _FEW = 5, 14
_SATURATED_WARN, _SATURATED_REFUSE = 0.01, 0.6
_ODD_ONE_OUT, _FAR_NUDGE, _CONTRADICTORY_R2 = 2.5, 0.25, 0.5
_FEW_SLOPES, _LITTLE_OF_THE_IMAGE = 0.9, 0.5
_BINS = 24
_SHALLOWEST_M = 1e-6  # a ball that sinks in less shows in no image
_LISTED = 6  # images that a warning names
_DRIFT_LEVELS, _MOVED_PX = 2.0, 1.0  # of which a warning tells
# Of a shift of the camera: the detail that shows it, how sharply it has to, and around a contact
_DETAIL_PX, _LEAST_PEAK, _AROUND, _BORDER_PX = (1.0, 4.0), 0.05, 2.3, 8


def render_presses(
    presses: Sequence[BallPress], calibration: Calibration
) -> tuple[list[RenderedPress], list[RenderedPress]]:
    """Render presses that the model need not have seen, as labelled and with nudged circles."""
    labelled, nudged = [], []
    for press in presses:
        placed = _lit(press, press.circle, calibration)
        labelled.append(_rendered(press, placed, calibration))
        for _ in range(_NUDGES):
            placed = _lit(press, calibration.scene.nudged(placed, calibration.model), calibration)
        nudged.append(_rendered(press, placed, calibration))
    return labelled, nudged


def _lit(press: BallPress, circle: Circle, found: Calibration) -> PlacedPress:
    """Return a press without its shadows, in its frame's light."""
    lit = without_shadows(press, circle, found)
    light, motion = found.scene.light(lit, circle, found.model), None
    if press.tracks is not None:
        profile, geometry = found.scene.profile, found.scene.geometry
        _, (motion,) = fit_motions([press.tracks], [circle], profile, geometry, found.motion)
    return PlacedPress(press=lit, circle=circle, light=light, motion=motion)


def _rendered(press: BallPress, placed: PlacedPress, found: Calibration) -> RenderedPress:
    """Return a press as it is, where it was placed."""
    started = time.perf_counter()
    return RenderedPress(
        press=press,
        circle=placed.circle,
        light=placed.light,
        motion=placed.motion,
        rendered=press_image(found, placed.circle, placed.motion),
        seconds=time.perf_counter() - started,
    )


def cross_validate(
    presses: Sequence[BallPress],
    scene: PressScene,
    *,
    fit: Callable[[Sequence[BallPress]], Calibration],
    folds: int = 7,
    jobs: int = 1,
    on_fold: Callable[[int], None] = lambda _: None,
) -> tuple[CheckScores, list[RenderedPress], list[RenderedPress], Calibration]:
    """Fit on all folds but one and score that one, for each; press i is in fold i modulo folds.

    ``on_fold`` gets the number of each fold that is done, from 0; the last is of all presses.

    Returns:
        Scores over all presses, each press as rendered by the model that had not seen it, in fold
        order, as labelled and with nudged circles, and the calibration from all presses.
    """
    labelled, nudged = [], []
    held_out = [presses[fold::folds] for fold in range(folds)]
    seen = [[p for i, p in enumerate(presses) if i % folds != fold] for fold in range(folds)]
    parts = [*zip(seen, held_out, strict=True), (presses, [])]
    fitted = parallel_map(partial(_fitted, fit), parts, jobs=jobs)
    with doing("fitting"):
        for fold, (_, found) in enumerate(fitted):
            calibration, as_labelled, as_nudged = found
            labelled += as_labelled
            nudged += as_nudged
            on_fold(fold)
    return check_scores(labelled, nudged, scene), labelled, nudged, calibration


def _fitted(
    fit: Callable[[Sequence[BallPress]], Calibration],
    presses: tuple[Sequence[BallPress], Sequence[BallPress]],
) -> tuple[Calibration, list[RenderedPress], list[RenderedPress]]:
    """Fit to some presses; return the calibration, and others as it renders them both ways."""
    seen, held_out = presses
    found = fit(seen)
    return found, *render_presses(held_out, found)


def check_scores(
    labelled: Sequence[RenderedPress], nudged: Sequence[RenderedPress], scene: PressScene
) -> CheckScores:
    """Score presses that a calibration has not seen, in the scene as it was taken."""
    moves = np.subtract([item.circle for item in nudged], [item.circle for item in labelled])
    levels = [item.light[0] for item in sorted(nudged, key=lambda item: item.press.name)]
    along = np.linspace(-0.5, 0.5, len(levels))
    drift = along @ np.array(levels) / max(float(along @ along), 1e-12)
    return CheckScores(
        **asdict(score_presses(nudged, scene, light_matched=True)),
        as_labelled=score_presses(labelled, scene, light_matched=True),
        as_labelled_frames_as_they_came=score_presses(labelled, scene, light_matched=False),
        light_rms_levels=float(np.sqrt(np.mean(np.square(levels)))),
        light_drift_levels=tuple(drift.tolist()),
        camera_moved_px=_camera_moved(nudged, scene),
        nudge_rms_px=float(np.sqrt(np.mean(moves**2))),
        markers=marker_scores(nudged, scene.geometry.mean_scale_m),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedPress(PlacedPress):
    """A real press beside its rendering: no-contact frame plus model, not rounded."""

    rendered: FloatArray  # [grey levels], shape [height, width, 3]
    seconds: float  # that this took, by the formula in NumPy [s]

    @property
    def image(self) -> ImageArray:
        """The rendering in the no-contact frame's light, RGB, uint8; nothing of its own frame."""
        return np.clip(np.rint(self.rendered), 0.0, 255.0).astype(np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class PressScores:
    """Scores over a set of presses."""

    r2: float  # share of the variance of the colour change explained inside the contacts
    mae: float  # mean absolute error inside the contacts [grey levels]
    ssim_crop: float
    r2_no_contact: float  # of the no-contact frame in place of the rendering; so the next two
    mae_no_contact: float
    ssim_crop_no_contact: float
    press_count: int
    ring_residual: float  # norm of the error over that of the real change, at 1.1 to 2.2 radii


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerScores:
    """How far markers are seen from where they are drawn, over all presses of a set."""

    tracked: int  # markers that were followed from the no-contact frame into the presses' images
    lost: int
    moved_px: float  # median motion of those within 1.6 radii of the contact [px]
    error_px: float  # median distance of drawn from tracked motion [px]
    error_m: float
    near_error_px: float  # median of those under and beside the contact [px]
    near_error_p90_px: float  # which nine of ten of those keep [px]
    tracking_error_px: float  # median standard error of a tracked motion along columns or rows [px]


def marker_scores(rendered: Sequence[RenderedPress], pixel_m: float) -> MarkerScores | None:
    """Compare the markers of presses with where they are drawn; None where none was followed."""
    motions = [item.motion for item in rendered if item.motion is not None]
    tracks = [item.press.tracks for item in rendered if item.press.tracks is not None]
    if not any(len(each.rest_px) for each in tracks):
        return None
    error = np.concatenate([motion.error_px for motion in motions])
    near = np.concatenate([motion.under for motion in motions])
    near |= not near.any()
    moved = np.concatenate([np.hypot(*each.motion_px.T) for each in tracks])
    return MarkerScores(
        tracked=len(error),
        lost=sum(each.lost for each in tracks),
        moved_px=float(np.median(moved[near])),
        error_px=float(np.median(error)),
        error_m=float(np.median(error)) * pixel_m,
        near_error_px=float(np.median(error[near])),
        near_error_p90_px=float(np.quantile(error[near], 0.9)),
        tracking_error_px=float(np.median(np.concatenate([each.error_px for each in tracks]))),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckScores(PressScores):
    """Scores of presses that the model has not seen: circles nudged, with each frame's light."""

    as_labelled: PressScores  # circles as labelled, with each frame's light
    as_labelled_frames_as_they_came: PressScores  # likewise, without that light
    light_rms_levels: float  # root mean square of the level of that light [grey levels]
    # By how much the level of red, green and blue changes from the first press, by name, to the
    # last, along a straight line [grey levels]
    light_drift_levels: tuple[float, ...]
    # By how much images lie to the right of and below the no-contact frame, median of all [px];
    # None where they show too little detail
    camera_moved_px: tuple[float, float] | None
    nudge_rms_px: float  # root mean square of the circles' moves in x, y and radius [px]
    markers: MarkerScores | None = None  # of sensors with markers


def _camera_moved(
    rendered: Sequence[RenderedPress], scene: PressScene
) -> tuple[float, float] | None:
    """Return the median shift of images by phase correlation, contacts and borders left out."""
    height, width = scene.background.shape[:2]
    rows, columns = np.indices((height, width))
    edge = np.minimum(np.minimum(rows, height - 1 - rows), np.minimum(columns, width - 1 - columns))
    frame, moved = detail(as_seen(scene.frame, np.zeros((3, 3)), scene)), []
    for item in rendered:
        away = item.circle.distance(columns, rows) > _AROUND * item.circle.radius_px
        shown = (away & (edge >= _BORDER_PX)).astype(np.float32)
        weight = cv2.GaussianBlur(shown, (0, 0), _DETAIL_PX[1])
        shift, peak = cv2.phaseCorrelate(frame * weight, detail(item.press.image) * weight)
        moved += [shift] if peak > _LEAST_PEAK else []
    if 2 * len(moved) < len(rendered):
        return None
    return tuple(np.median(moved, axis=0).tolist())


def detail(image: AnyArray) -> Float32Array:
    """Return what is finer than lamps and contacts in an image, of all colours together."""
    grey = image.mean(axis=-1, dtype=np.float32)
    return np.asarray(np.subtract(*(cv2.GaussianBlur(grey, (0, 0), s) for s in _DETAIL_PX)))


def score_presses(
    rendered: Sequence[RenderedPress], scene: PressScene, *, light_matched: bool
) -> PressScores:
    """Score renderings against the real presses."""
    changes, errors, similarities, floors, ring = [], [], [], [], np.zeros(2)
    for item in rendered:
        light = item.light if light_matched else np.zeros_like(item.light)
        real = item.press.image.astype(np.float64)
        image = as_seen(item.rendered, light, scene)
        without = as_seen(scene.frame, light, scene)
        inside = contact_mask(item.press.circle, *real.shape[:2])
        changes.append((real - without)[inside])
        errors.append((image - real)[inside])
        rows, columns = np.ogrid[: real.shape[0], : real.shape[1]]
        away = item.press.circle.distance(columns, rows) / item.press.circle.radius_px
        around = (away >= _RING[0]) & (away < _RING[1]) & item.press.shown
        ring += np.sum((image - real)[around] ** 2), np.sum((real - without)[around] ** 2)
        window = crop_window(item.press.circle, *real.shape[:2])
        similarities.append(_SSIM(real[window], image[window]))
        floors.append(_SSIM(real[window], without[window]))
    change, error = np.concatenate(changes), np.concatenate(errors)
    variance = np.sum((change - change.mean(axis=0)) ** 2)
    return PressScores(
        r2=float(1.0 - np.sum(error**2) / variance),
        mae=float(np.mean(np.abs(error))),
        ssim_crop=float(np.mean(similarities)),
        r2_no_contact=float(1.0 - np.sum(change**2) / variance),
        mae_no_contact=float(np.mean(np.abs(change))),
        ssim_crop_no_contact=float(np.mean(floors)),
        press_count=len(rendered),
        ring_residual=float(np.sqrt(ring[0] / max(ring[1], 1e-300))),
    )


def as_seen(levels: FloatArray, light: FloatArray, scene: PressScene) -> FloatArray:
    """Return levels [height, width, 3] as a camera sees them in a frame's light: 0 to 255."""
    return np.asarray(np.clip(np.rint(levels + scene.frame_light_image(light)), 0.0, 255.0))


def contact_mask(circle: Circle, height: int, width: int) -> np.ndarray[tuple[int, int]]:
    """Return True inside the circle, shape [height, width]."""
    rows, columns = np.ogrid[:height, :width]
    return circle.distance(columns, rows) < circle.radius_px


def crop_side(width: int) -> int:
    """Return the side of the square that SSIM is of, for images so wide [px]."""
    return round(CROP_SHARE * width)


def crop_window(circle: Circle, height: int, width: int) -> tuple[slice, slice]:
    """Return the square around the circle's centre that SSIM is of, moved to lie in the image."""
    side = crop_side(width)
    top = int(np.clip(round(circle.y_px) - side // 2, 0, max(0, height - side)))
    left = int(np.clip(round(circle.x_px) - side // 2, 0, max(0, width - side)))
    return slice(top, top + side), slice(left, left + side)


def held_out_errors(rendered: Sequence[RenderedPress], scene: PressScene) -> list[float]:
    """Return each press's mean absolute error inside its contact, light taken off [grey levels]."""
    return [score_presses([item], scene, light_matched=True).mae for item in rendered]


def check_before(
    presses: Sequence[BallPress], geometry: CameraGeometry, *, ball_radius_m: float
) -> list[str]:
    """Return warnings of presses that nothing is fitted to yet; refuse those of no use."""
    shares = {}
    for press in presses:
        inside = press.image[contact_mask(press.circle, *press.image.shape[:2])]
        saturated = ~exposed(inside).all(axis=-1)
        shares[press.name] = float(np.mean(saturated)) if inside.size else 0.0
        radius_m = press.circle.radius_px * geometry.mean_scale_m
        if radius_m >= LARGEST * ball_radius_m or radius_m**2 < 2.0 * _SHALLOWEST_M * ball_radius_m:
            raise ConfigError(
                f"{press.name}: a contact of radius {radius_m * 1e3:.3g} mm cannot be of a ball of "
                f"diameter {ball_radius_m * 2e3:.2f} mm",
                remedy="correct the circle's radius_px, --scale or --ball-diameter",
            )
    few = f"only {len(presses)} presses: {_FEW} or more, all over the image, are wanted"
    warnings = [few] if len(presses) < _FEW else []
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
    """Return warnings of what cross-validation says; refuse presses that contradict each other."""
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
    far = []
    for item in held_out:
        label, found = item.press.circle, item.circle
        move = np.abs(np.subtract(found, label)).max()
        if move > _FAR_NUDGE * label.radius_px:
            far.append(
                f"{item.press.name}: the image wants its circle {move:.0f} px off the label "
                f"({found.x_px:.0f}, {found.y_px:.0f}, radius {found.radius_px:.0f} px)"
            )
    if len(far) > _LISTED and 2 * len(far) > len(held_out):
        far = [f"{far[0]}, likewise {len(far) - 1} others; check --ball-diameter and --scale"]
    return [*warnings, *far]


def check_session(scores: CheckScores) -> list[str]:
    """Warn of light and of a camera that are not those of the no-contact frame."""
    warnings, drift = [], max(scores.light_drift_levels, key=abs)
    if abs(drift) > _DRIFT_LEVELS:
        warnings.append(
            f"the light drifts by {drift:+.1f} grey levels from the first press to the last; let "
            "the lamps warm up, and switch automatic exposure and white balance off"
        )
    moved = scores.camera_moved_px
    if moved is not None and np.hypot(*moved) > _MOVED_PX:
        warnings.append(
            f"the images lie {moved[0]:+.1f} px to the right of and {moved[1]:+.1f} px below the "
            "no-contact frame: camera or gel moved in between; take it anew"
        )
    return warnings


@dataclass(frozen=True, slots=True, kw_only=True)
class SlopeCoverage:
    """How often each slope was seen."""

    tilt_limit: float
    slopes_seen_share: float  # of the disc of tilts up to the limit: what a press shows at least
    image_share: float  # part of the image that lies in at least one contact
    tilt_edges: FloatArray  # borders of bins of tilt (sine of the surface's angle), [_BINS + 1]
    presses_seen: Int64Array  # that show a tilt, by tilt along rows and columns, [_BINS, _BINS]


def slope_coverage(circles: Sequence[Circle], scene: PressScene) -> SlopeCoverage:
    """Count slopes and places inside the contacts; at least one circle."""
    height, width = scene.background.shape[:2]
    rows, columns = (grid.ravel() for grid in np.indices((height, width)))
    inside = []
    touched = np.zeros(len(rows), dtype=np.bool_)
    for circle in circles:
        near = circle.distance(columns, rows) <= circle.radius_px
        inside.append(scene.surface(circle, columns[near], rows[near])[:2])
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
