"""From a folder of ball presses to a calibration file, its scores and its figures."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle as Outline

from sim.optics.calibrate.ball_press import (
    BallPress,
    Circle,
    check_presses_fit,
    check_size,
    read_ball_presses,
    read_rgb,
)
from sim.optics.calibrate.circle_and_light import (
    PressScene,
    find_circle,
    pressed_scene,
    wrong_label,
)
from sim.optics.calibrate.colour_fit import Calibration
from sim.optics.calibrate.cross_validation import (
    FEWEST,
    CheckScores,
    RenderedPress,
    SlopeCoverage,
    as_seen,
    check_after,
    check_before,
    check_coverage,
    check_scores,
    check_session,
    crop_window,
    cross_validate,
    held_out_errors,
    render_presses,
    slope_coverage,
)
from sim.optics.calibrate.gel_profile import DEPTHS_M
from sim.optics.calibrate.shadow_blur_fit import BLUR_PX, SHADOWS, calibrate_presses
from sim.scene.scene import Preset
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from tacauchy_rig import __version__
from tacauchy_rig.app.replay import chosen_optics as replay_optics
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.run import IMAGES_SHA256
from tacauchy_rig.core.store.atomic_write import writing
from tacauchy_rig.core.store.run_files import file_sha256
from tacauchy_rig.core.time_limit_and_progress import Remaining, doing

_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsRequest:
    """What a calibration is made of."""

    folder: Path
    background: Path  # the no-contact frame, in the folder or a path of its own
    # Table of contacts, in the folder or a path of its own; None takes ``circles.csv`` of the
    # folder where there is one, and finds the contacts in the images where not
    circles: Path | None
    ball_diameter_m: float  # diameter of the ball [m]
    scale_px_m: tuple[float, float]  # pixels per metre along columns and rows
    out: Path
    check: Path | None
    sensor: Sensor  # its pad is pressed in the simulator to know the gel around the ball
    preset: Preset
    folds: int
    jobs: int  # fits at a time, each in a process of its own
    # Of a run, by the name of their image; empty for a folder of images
    trials: dict[str, int] = field(default_factory=dict)
    # Where the ball's axis was, x and y from the pad's centre [m], by image; empty where unknown
    places: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def figures(self) -> tuple[Path, Path]:
        """Where the slopes that were seen, and the presses held out, are drawn."""
        stem = self.out.stem
        return self.out.with_name(f"{stem}_slopes.png"), self.out.with_name(f"{stem}_held_out.png")


@dataclass(frozen=True, slots=True, kw_only=True)
class PressFolder:
    """The presses of a folder."""

    background: ImageArray  # no-contact frame of their session, RGB, shape [height, width, 3]
    presses: list[BallPress]
    labelled: bool = True  # whether their circles are stated; otherwise they are still to be found


def read_input(request: OpticsRequest) -> tuple[CameraGeometry, PressFolder, PressFolder]:
    """Read everything that a calibration needs, and refuse what cannot be calibrated from.

    Returns:
        Where pixels look, the presses, and those of the check, none without one.

    Raises:
        ConfigError: A file is missing or damaged, images differ in size, circles are impossible,
            or there are too few presses.
    """
    if request.out.suffix != ".npz":
        raise ConfigError(f"{request.out} is no .npz file", remedy="give --out calibration.npz")
    for folder in (request.folder, request.check):
        if folder is not None and not folder.is_dir():
            raise ConfigError(f"{folder} is no folder", remedy="give a folder of images")
    path = _in_folder_or_as_given(request.background, request.folder)
    background = read_rgb(path, field="--background")
    height, width = background.shape[:2]
    scale_x_m, scale_y_m = (1.0 / scale for scale in request.scale_px_m)
    geometry = CameraGeometry.centred(width, height, scale_x_m=scale_x_m, scale_y_m=scale_y_m)
    presses = _read_folder(request, request.folder, background)
    if len(presses.presses) < FEWEST:
        raise ConfigError(
            f"{len(presses.presses)} ball presses are too few to calibrate and to check by",
            remedy=f"give at least {FEWEST}, better 20 all over the image and at several depths",
        )
    if presses.labelled:
        check_before(presses.presses, geometry, ball_radius_m=0.5 * request.ball_diameter_m)
    check = PressFolder(background=background, presses=[])
    if request.check is not None:
        own = request.check / request.background.name
        if own.exists():
            background = read_rgb(own)
            check_size(own.name, background, presses.background)
        check = _read_folder(request, request.check, background)
    return geometry, presses, check


def _read_folder(request: OpticsRequest, folder: Path, background: ImageArray) -> PressFolder:
    """Read the presses of a folder, with the table of their circles if there is one."""
    table = folder / replay_optics.CIRCLES if (folder / replay_optics.CIRCLES).exists() else None
    if request.circles is not None:
        own = folder / request.circles.name
        is_main = folder == request.folder
        table = _in_folder_or_as_given(request.circles, folder) if is_main else table
        table = own if own.exists() else table
    presses = read_ball_presses(folder, table) if table else _images(request, folder)
    check_presses_fit(presses, background)
    return PressFolder(background=background, presses=presses, labelled=table is not None)


def find_presses(
    read: PressFolder, scene: PressScene, *, ball_radius_m: float
) -> tuple[list[BallPress], list[str]]:
    """Return the presses with markers followed and contacts found, where no label states these.

    Presses whose label their image contradicts are left out, and named in the warnings.

    Raises:
        ConfigError: An image shows no contact.
    """
    presses, wrong = [], []
    for press in map(scene.followed, read.presses):
        if not read.labelled:
            circle = find_circle(press, scene, ball_radius_m=ball_radius_m)
            presses.append(replace(press, circle=circle))
        elif contradiction := wrong_label(press, scene, ball_radius_m=ball_radius_m):
            wrong.append(contradiction)
        else:
            presses.append(press)
    return presses, wrong


def _in_folder_or_as_given(path: Path, folder: Path) -> Path:
    """Return the path in the folder if it is there, else as it stands."""
    return folder / path if (folder / path).exists() else path


def _images(request: OpticsRequest, folder: Path) -> list[BallPress]:
    """Return the images of a folder but those that are no presses; circles are to be found."""
    frame = _in_folder_or_as_given(request.background, request.folder)
    others = {p.resolve() for p in (frame, folder / frame.name, *request.figures)}
    unplaced = Circle(x_px=0.0, y_px=0.0, radius_px=1.0)
    presses = [
        BallPress(name=path.name, image=read_rgb(path), circle=unplaced)
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in _IMAGE_SUFFIXES and path.resolve() not in others
    ]
    if not presses:
        raise ConfigError(f"{folder} holds no image", remedy="give a folder of PNG or JPEG files")
    return presses


# Processor seconds of simulated presses, of figures, of a press's fit with shadows or without
_PRESSES_S, _DRAW_S, _FIT_S = 3.2, 4.5, {True: 0.41, False: 0.14}


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsResult:
    """What came out: scores, coverage, warnings and the files written."""

    cross_validation: CheckScores
    check: CheckScores | None
    coverage: SlopeCoverage
    warnings: list[str]
    # Of each press: name, circle as labelled and as nudged [px], and its mean absolute error when
    # held out [grey levels]
    presses: list[dict[str, Any]]
    provenance: dict[str, Any]
    files: list[Path]


def calibrate_and_check(
    request: OpticsRequest, *, on_step: Callable[[str, int, int, str], None] = lambda *_: None
) -> tuple[OpticsResult, dict[int, RenderedPress]]:
    """Read, refuse or warn, cross-validate, fit, check, and write the calibration and its figures.

    Args:
        on_step: Told what was done, as which step of how many, and how long the others may take.

    Returns:
        What came out, and every press as a model that had not seen it renders it where it was
        labelled or found, by its place in their table, from 1.

    Raises:
        ConfigError: A file is missing or damaged, or the presses cannot be calibrated from.
        ConvergenceError: The simulated ball press finds no equilibrium.
        RecordError: A result cannot be written.
    """
    geometry, given, given_check = read_input(request)
    radius_m, shadows = 0.5 * request.ball_diameter_m, request.sensor.optics.shadows
    count, depths = len(given.presses), len(DEPTHS_M)
    folds = min(request.folds, count)
    fit_s = count * _FIT_S[shadows is not None]
    jobs = min(request.jobs, folds)
    left = Remaining((folds + 1) * fit_s, jobs=jobs)
    left.add(_PRESSES_S + _DRAW_S, alone=True)

    def tell(what: str, done: int) -> None:
        on_step(what, done, depths + folds + 1, str(left))

    def pressed(done: int) -> None:
        left.spend(_PRESSES_S / depths, alone=True)
        tell(f"ball pressed {DEPTHS_M[done - 1] * 1e3:.2f} mm deep in the simulator", done)

    def fitted(fold: int) -> None:
        if fold % jobs == 0:  # those that began together end together
            left.spend(fit_s * min(jobs, folds + 1 - fold))
        what = f"fit without fold {fold + 1} of {folds}" if fold < folds else "fit to all presses"
        tell(what, depths + fold + 1)

    tell("pressing the ball in the simulator", 0)
    scene = pressed_scene(
        request.sensor,
        given.background,
        geometry,
        ball_diameter_m=request.ball_diameter_m,
        preset=request.preset,
        on_press=pressed,
    )
    is_same = given_check.background is given.background
    there = scene if is_same else scene.over(given_check.background)
    with doing("finding the contacts"):
        presses, warnings = find_presses(given, scene, ball_radius_m=radius_m)
        checked, wrong = find_presses(given_check, there, ball_radius_m=radius_m)
    if len(presses) < FEWEST:
        raise ConfigError(
            f"{len(warnings)} of {count} labels contradict their images: {warnings[0]}",
            remedy="check that the circles are of these images, and their columns",
        )
    warnings += check_before(presses, geometry, ball_radius_m=radius_m) + wrong
    fit = partial(calibrate_presses, scene=scene, shadows=shadows)
    scores, labelled, held_out, calibration = cross_validate(
        presses, scene, fit=fit, folds=folds, jobs=request.jobs, on_fold=fitted
    )
    coverage = slope_coverage(calibration.circles, calibration.scene)
    warnings += check_after(scores, held_out, scene) + check_coverage(coverage)
    seen = calibration if there is scene else replace(calibration, scene=there)
    check = check_scores(*render_presses(checked, seen), there) if checked else None
    warnings += check_session(scores) + ([] if check is None else check_session(check))
    provenance = _provenance(request, presses, scores, calibration)
    pairs = zip(presses, calibration.circles, strict=True)
    placed = [(c, request.places[p.name]) for p, c in pairs if p.name in request.places]
    try:
        if placed:
            view, told = replay_optics.fitted_view(
                placed, geometry, request.sensor.pad, ball_radius_m=radius_m
            )
            provenance[replay_optics.VIEW] = {
                name: getattr(view.geometry, name) for name in replay_optics.VIEWED
            }
            tell(told, depths + folds + 1)
    except ConfigError as error:
        warnings.append(f"the view stays as stated: {error.message}")
    files = _write_files(request, calibration, coverage, held_out, scene, provenance)
    names = [item.press.name for item in held_out]
    errors = dict(zip(names, held_out_errors(held_out, scene), strict=True))
    result = OpticsResult(
        cross_validation=scores,
        check=check,
        coverage=coverage,
        warnings=warnings,
        presses=[
            {
                "image": press.name,
                "labelled": press.circle._asdict(),
                "nudged": circle._asdict(),
                "held_out_mae_levels": errors[press.name],
            }
            for press, circle in zip(presses, calibration.circles, strict=True)
        ],
        provenance=provenance,
        files=files,
    )
    order = [press.name for press in given.presses]
    return result, {order.index(item.press.name) + 1: item for item in labelled}


def _provenance(
    request: OpticsRequest, presses: Sequence[BallPress], scores: CheckScores, found: Calibration
) -> dict[str, Any]:
    geometry = found.scene.geometry
    digest, distance_m = sha256(), found.motion.distance_m
    for press in presses:
        digest.update(press.name.encode())
        digest.update(press.image.tobytes())
        digest.update(repr(press.circle._asdict()).encode())
    return {
        "source": f"{len(presses)} ball presses in {request.folder.resolve().name}",
        "presses_sha256": digest.hexdigest(),
        IMAGES_SHA256: sorted(
            {sha256(press.image.tobytes()).hexdigest() for press in presses}
            | {file_sha256(request.folder / press.name, what="a press") for press in presses}
        ),
        "ball_diameter_m": request.ball_diameter_m,
        replay_optics.WIDTH: geometry.width,
        replay_optics.HEIGHT: geometry.height,
        replay_optics.SCALE_X: geometry.scale_x_m,
        replay_optics.SCALE_Y: geometry.scale_y_m,
        "sensor": request.sensor.title,
        "preset": request.preset.value,
        "version": __version__,
        "held_out_r2": scores.r2,
        "held_out_mae_levels": scores.mae,
        "held_out_ssim_crop": scores.ssim_crop,
        BLUR_PX: found.blur_px,
        replay_optics.CAMERA_DISTANCE: distance_m if math.isfinite(distance_m) else None,
        SHADOWS: None if found.shadows is None else asdict(found.shadows),
    }


def _write_files(
    request: OpticsRequest,
    calibration: Calibration,
    coverage: SlopeCoverage,
    held_out: Sequence[RenderedPress],
    scene: PressScene,
    provenance: dict[str, Any],
) -> list[Path]:
    model, out = calibration.model, request.out
    slopes, drawn = request.figures
    # The presses held out in their frames' light, each by its own name.
    renderings = drawn.with_suffix("")
    ordered = sorted(held_out, key=lambda item: item.press.name)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        replace(model, provenance={**model.provenance, **provenance}).save(out)
        draw_coverage(coverage, calibration.circles, calibration.scene, slopes)
        draw_presses(ordered, scene, drawn)
        renderings.mkdir(parents=True, exist_ok=True)
        for item in ordered:
            image = as_seen(item.rendered, item.light, scene).astype(np.uint8)
            name = Path(item.press.name).with_suffix(".png").name
            (renderings / name).write_bytes(encode_png(image))
    return [out, slopes, drawn, renderings]


_DPI = 150
_SETS_A_ROW = 4
_DIFFERENCE_GAIN = 4.0


def draw_coverage(
    coverage: SlopeCoverage, circles: Sequence[Circle], scene: PressScene, path: Path
) -> None:
    """Draw which tilts were seen by how many presses, and where the contacts lay, as PNG."""
    figure = Figure(figsize=(7.2, 3.0), layout="constrained")
    slopes, places = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    shown = np.ma.masked_equal(coverage.presses_seen, 0)
    steepest_deg = math.degrees(math.asin(min(coverage.tilt_limit, 1.0)))
    mesh = slopes.pcolormesh(
        coverage.tilt_edges, coverage.tilt_edges, shown, cmap="viridis", vmin=0
    )
    slopes.add_patch(Outline((0, 0), coverage.tilt_limit, fill=False, color="#777777"))
    slopes.set(
        aspect="equal",
        xlabel="tilt along columns",
        ylabel="tilt along rows",
        title=f"{coverage.slopes_seen_share:.0%} of slopes to {steepest_deg:.0f} deg",
    )
    slopes.invert_yaxis()
    figure.colorbar(mesh, ax=slopes, label="presses that show it")
    places.imshow(np.clip(scene.frame / 255.0, 0.0, 1.0))
    for circle in circles:
        places.add_patch(
            Outline((circle.x_px, circle.y_px), circle.radius_px, fill=False, lw=0.8, color="#222")
        )
    places.set(
        xlabel="column [px]",
        ylabel="row [px]",
        title=f"{len(circles)} contacts, {coverage.image_share:.0%} of the image",
    )
    figure.savefig(path, dpi=_DPI)


def draw_presses(held_out: Sequence[RenderedPress], scene: PressScene, path: Path) -> None:
    """Draw each press's crop: real, rendered in its light, and four times their difference."""
    rows = math.ceil(len(held_out) / _SETS_A_ROW)
    figure = Figure(figsize=(3.0 * _SETS_A_ROW, 1.2 * rows + 0.3), layout="constrained")
    axes = figure.subplots(rows, _SETS_A_ROW, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, item in zip(axes, held_out, strict=False):
        real = item.press.image.astype(np.float64)
        rendered = as_seen(item.rendered, item.light, scene)
        difference = 127.0 + _DIFFERENCE_GAIN * (rendered - real)
        window = crop_window(item.press.circle, *real.shape[:2])
        crops = [part[window] for part in (real, rendered, difference)]
        axis.imshow(np.clip(np.concatenate(crops, axis=1) / 255.0, 0.0, 1.0))
        axis.set_title(item.press.name, fontsize=7)
    figure.suptitle(f"real | rendered | grey + {_DIFFERENCE_GAIN:g} x (rendered - real)", size=8)
    figure.savefig(path, dpi=_DPI)
