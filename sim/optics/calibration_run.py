"""From a folder of ball presses to a calibration file, its scores and its figures."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim.optics.ball_press import BallPress, Circle, images_in, read_ball_presses, read_rgb
from sim.optics.ball_profile import ball_profiles
from sim.optics.blur import BLUR_PX
from sim.optics.calibrate import Calibration
from sim.optics.calibration_figures import draw_coverage, draw_presses
from sim.optics.cross_validation import CheckScores, check_presses, cross_validate
from sim.optics.find_circle import find_circle
from sim.optics.geometry import CameraGeometry
from sim.optics.press_calibration import calibrate_presses
from sim.optics.press_checks import check_after, check_before, check_coverage
from sim.optics.press_scene import PressScene
from sim.optics.press_scores import RenderedPress, held_out_errors
from sim.optics.printed_markers import marker_mask
from sim.optics.rest_slope import rest_slopes
from sim.optics.sensor_lamps import lamp_count_of
from sim.optics.shadow import SHADOWS
from sim.optics.slope_coverage import SlopeCoverage, slope_coverage
from sim.scene import Preset
from sim.sensor import Sensor
from tacauchy_rig import __version__
from tacauchy_rig.errors import ConfigError, RecordError

log = logging.getLogger(__name__)

_CIRCLES = "circles.csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsRequest:
    """What a calibration is made of.

    Attributes:
        folder: Images of a ball pressed into the sensor.
        background: The no-contact frame, in the folder or a path of its own.
        circles: Table of contacts, in the folder or a path of its own; None takes ``circles.csv``
            of the folder where there is one, and finds the contacts in the images where not.
        ball_diameter_m: Diameter of the ball [m].
        scale_px_m: Pixels per metre along columns and rows.
        out: Calibration file.
        check: Folder of other labelled presses.
        sensor: Its pad is pressed in the simulator to know the gel around the ball.
        preset: Of those presses.
        folds: Of the cross-validation.
    """

    folder: Path
    background: Path
    circles: Path | None
    ball_diameter_m: float
    scale_px_m: tuple[float, float]
    out: Path
    check: Path | None
    sensor: Sensor
    preset: Preset
    folds: int = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsResult:
    """What came out: scores, coverage, warnings and the files written.

    Attributes:
        presses: Of each press: name, circle as labelled and as nudged [px], and its mean absolute
            error when held out [grey levels].
    """

    cross_validation: CheckScores
    check: CheckScores | None
    coverage: SlopeCoverage
    warnings: list[str]
    presses: list[dict[str, Any]]
    provenance: dict[str, Any]
    written: list[Path]

    def as_json(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "cross_validation": self.cross_validation.as_json(),
            "check": None if self.check is None else self.check.as_json(),
            "coverage": {
                "tilt_limit": self.coverage.tilt_limit,
                "slopes_seen_share": self.coverage.share,
                "image_share": self.coverage.image_share,
                "tilt_edges": self.coverage.edges.tolist(),
                "presses_seen": self.coverage.presses_seen.tolist(),
            },
            "warnings": self.warnings,
            "presses": self.presses,
            "provenance": self.provenance,
            "files": [str(path) for path in self.written],
        }


def calibrate_and_check(request: OpticsRequest) -> OpticsResult:
    """Read, refuse or warn, cross-validate, fit, check, and write the calibration and its figures.

    Raises:
        ConfigError: A file is missing or damaged, or the presses cannot be calibrated from.
        ConvergenceError: The simulated ball press finds no equilibrium.
        RecordError: A result cannot be written.
    """
    if request.out.suffix != ".npz":
        raise ConfigError(f"{request.out} is no .npz file", remedy="give --out calibration.npz")
    background = read_rgb(_found(request.background, request.folder))
    radius_m = 0.5 * request.ball_diameter_m
    geometry = _geometry(request.scale_px_m, background.shape[1], background.shape[0])
    scene = PressScene(
        geometry=geometry,
        masked=marker_mask(background, request.sensor.markers, geometry),
        background=background.astype(np.float64),
        profile=ball_profiles(
            request.sensor, ball_diameter_m=request.ball_diameter_m, preset=request.preset
        ),
        rest_slope=rest_slopes(request.sensor.pad, geometry),
        lamp_count=lamp_count_of(request.sensor),
    )
    presses = _presses(request, scene)
    warnings = check_before(presses, scene.geometry, ball_radius_m=radius_m)
    log.info("cross-validating %d presses", len(presses))
    fit = partial(calibrate_presses, scene=scene, sensor=request.sensor)
    folds = min(request.folds, len(presses))
    scores, held_out = cross_validate(presses, scene, fit=fit, folds=folds)
    warnings += check_after(scores, held_out, scene)
    calibration = fit(presses)
    coverage = slope_coverage(calibration.circles, calibration.scene)
    warnings += check_coverage(coverage)
    checked = None
    if request.check is not None:
        others = read_ball_presses(request.check, _circle_table(request, request.check))
        checked, _ = check_presses(others, calibration, scene)
    provenance = _provenance(request, presses, scores)
    shadows = calibration.shadows
    provenance[BLUR_PX] = calibration.blur_px
    provenance[SHADOWS] = None if shadows is None else shadows.as_json()
    written = _write(request.out, calibration, coverage, held_out, scene, provenance)
    return OpticsResult(
        cross_validation=scores,
        check=checked,
        coverage=coverage,
        warnings=warnings,
        presses=_rows(presses, calibration.circles, held_out, scene),
        provenance=provenance,
        written=written,
    )


def _geometry(scale_px_m: tuple[float, float], width: int, height: int) -> CameraGeometry:
    return CameraGeometry(
        width=width,
        height=height,
        scale_x_m=1.0 / scale_px_m[0],
        scale_y_m=1.0 / scale_px_m[1],
        centre_x_px=0.5 * (width - 1),
        centre_y_px=0.5 * (height - 1),
    )


def _found(path: Path, folder: Path) -> Path:
    """Return the path in the folder if it is there, else as it stands."""
    return folder / path if (folder / path).exists() else path


def _circle_table(request: OpticsRequest, folder: Path) -> Path:
    name = Path(request.circles.name) if request.circles is not None else Path(_CIRCLES)
    return folder / name if (folder / name).exists() else folder / _CIRCLES


def _presses(request: OpticsRequest, scene: PressScene) -> list[BallPress]:
    if request.circles is not None:
        return read_ball_presses(request.folder, _found(request.circles, request.folder))
    if (request.folder / _CIRCLES).exists():
        return read_ball_presses(request.folder, request.folder / _CIRCLES)
    radius_m = 0.5 * request.ball_diameter_m
    presses = []
    for path in images_in(request.folder, but=_found(request.background, request.folder)):
        image = read_rgb(path)
        if image.shape != scene.background.shape:
            raise ConfigError(
                f"{path.name} has not the size of the no-contact frame",
                remedy="take both with the same camera mode, crop and size",
            )
        circle = find_circle(path.name, image, scene, ball_radius_m=radius_m)
        presses.append(BallPress(name=path.name, image=image, circle=circle))
    return presses


def _provenance(
    request: OpticsRequest, presses: Sequence[BallPress], scores: CheckScores
) -> dict[str, Any]:
    digest = hashlib.sha256()
    for press in presses:
        digest.update(press.name.encode())
        digest.update(press.image.tobytes())
        digest.update(repr(asdict(press.circle)).encode())
    return {
        "source": f"{len(presses)} ball presses in {request.folder.resolve().name}",
        "presses_sha256": digest.hexdigest(),
        "ball_diameter_m": request.ball_diameter_m,
        "scale_x_m_px": 1.0 / request.scale_px_m[0],
        "scale_y_m_px": 1.0 / request.scale_px_m[1],
        "sensor": request.sensor.title,
        "preset": request.preset.value,
        "version": __version__,
        "held_out_r2": scores.nudged.r2,
        "held_out_mae_levels": scores.nudged.mae,
        "held_out_ssim_crop": scores.nudged.ssim_crop,
    }


def _write(
    out: Path,
    calibration: Calibration,
    coverage: SlopeCoverage,
    held_out: Sequence[RenderedPress],
    scene: PressScene,
    provenance: dict[str, Any],
) -> list[Path]:
    model = calibration.model
    slopes = out.with_name(f"{out.stem}_slopes.png")
    pictures = out.with_name(f"{out.stem}_held_out.png")
    ordered = sorted(held_out, key=lambda item: item.press.name)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        replace(model, provenance={**model.provenance, **provenance}).save(out)
        draw_coverage(coverage, calibration.circles, calibration.scene, slopes)
        draw_presses(ordered, scene, pictures)
    except OSError as error:
        raise RecordError(
            f"{out}: cannot be written: {error.strerror}", remedy="give --out another path"
        ) from error
    return [out, slopes, pictures]


def _rows(
    presses: Sequence[BallPress],
    nudged: Sequence[Circle],
    held_out: Sequence[RenderedPress],
    scene: PressScene,
) -> list[dict[str, Any]]:
    errors = {
        item.press.name: error
        for item, error in zip(held_out, held_out_errors(held_out, scene), strict=True)
    }
    return [
        {
            "image": press.name,
            "labelled": asdict(press.circle),
            "nudged": asdict(circle),
            "held_out_mae_levels": errors[press.name],
        }
        for press, circle in zip(presses, nudged, strict=True)
    ]
