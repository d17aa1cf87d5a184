"""A run of ball presses as what its own optics are calibrated from, and what that gave."""

import math
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from reports.evidence.frames_and_curves import AttemptReading, RunReading, median_image
from sim.optics.calibrate.cross_validation import PressScores, crop_side
from sim.scene.indenter import Sphere
from sim.scene.scene_parsing import parse_indenter
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.calibration.optics.from_folder import OpticsRequest, OpticsResult
from tacauchy_rig.app.importing.text_tables import as_csv
from tacauchy_rig.app.replay.chosen_optics import CIRCLES, NO_CONTACT
from tacauchy_rig.app.replay.simulator_inputs import indenter_of, sensor_of
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.run import CalibratedOptics, HeldOutPress, ImageAgreement
from tacauchy_rig.core.store.atomic_write import write_atomically

DEFAULT_SENSOR = "gelsight-mini"
CIRCLE_COLUMNS = ("image", "center_x_px", "center_y_px", "radius_px")
_PLAIN_NAME = re.compile(r"[\w][\w .-]{0,99}")
_SAME_BALL = 1e-3


def request_of(
    folder: Path,
    run: RunReading | None,
    *,
    background: Path | None,
    ball_diameter_m: float | None,
    scale_px_m: tuple[float, float] | None,
    out: Path | None,
    sensor: str | None,
    **further: Any,
) -> OpticsRequest:
    """Return what optics are calibrated from: a folder's presses, or a run's with what it knows.

    Args:
        folder: Of images, or of the run.
        further: Other fields of the request.

    Raises:
        ConfigError: A folder of images lacks something, or a run's presses are of no ball.
        RecordError: No press of the run has an image.
    """
    trials: dict[str, int] = {}
    places: dict[str, tuple[float, float]] = {}
    if run is not None:
        own = sensor_of(run.store.config) if sensor is None else load_sensor(sensor)
        ball_diameter_m, presses = _ball_presses(run, ball_diameter_m)
        folder, trials = _presses_folder(run), _write_presses(run, presses)
        stated = {name: run.store.imported_trials.get(index) for name, index in trials.items()}
        places = {n: each.place_m for n, each in stated.items() if each and each.place_m}
        background = background or Path(NO_CONTACT)
        scale_px_m = scale_px_m or (1.0 / own.camera.scale_x_m, 1.0 / own.camera.scale_y_m)
        out = out or run.store.paths.calibration
    elif background is None or ball_diameter_m is None or scale_px_m is None or out is None:
        raise ConfigError(
            f"{folder} is no run folder, so ball and scale are unknown",
            remedy="give --background, --ball-diameter, --scale and --out",
        )
    else:
        own = load_sensor(sensor or DEFAULT_SENSOR)
    return OpticsRequest(
        folder=folder,
        background=background,
        ball_diameter_m=ball_diameter_m,
        scale_px_m=scale_px_m,
        out=out,
        sensor=own,
        trials=trials,
        places=places,
        **further,
    )


def keep_optics(run: RunReading, request: OpticsRequest, result: OpticsResult) -> None:
    """Keep in the run's folder what its calibration gave, for its report.

    Raises:
        RecordError: The disk is full.
    """
    found = result.cross_validation
    with run.store.lock():
        run.store.optics.save(
            CalibratedOptics(
                ball_diameter_m=request.ball_diameter_m,
                scale_px_m=request.scale_px_m,
                sensor=request.sensor.title,
                preset=request.preset.value,
                labelled=(request.folder / CIRCLES).exists(),
                folds=min(request.folds, len(result.presses)),
                crop_px=crop_side(result.provenance["width_px"]),
                nudged=_agreement(found),
                as_labelled=_agreement(found.as_labelled),
                no_contact_light=_agreement(found.as_labelled_frames_as_they_came),
                presses=tuple(_held_out(row, request.trials) for row in result.presses),
                warnings=tuple(result.warnings),
            )
        )


def _ball_presses(
    run: RunReading, ball_diameter_m: float | None
) -> tuple[float, dict[int, AttemptReading]]:
    """Return the diameter [m] and the presses of one ball of a run, by trial.

    Of several balls the one with the most presses is taken, unless a diameter is given. A run of no
    ball is taken whole if a diameter is given: whoever gives it knows.
    """
    own = indenter_of(run.store.config)
    balls: dict[float, list[int]] = {}
    others: list[int] = []
    for index in run.records:
        imported = run.store.imported_trials.get(index)
        named = imported.indenter if imported is not None else ""
        indenter = parse_indenter(named) if named else own
        if isinstance(indenter, Sphere):
            balls.setdefault(indenter.diameter_m, []).append(index)
        else:
            others.append(index)
    if not balls and ball_diameter_m is not None:
        balls = {ball_diameter_m: others}
    wanted = ball_diameter_m
    chosen = [d for d in balls if wanted is None or math.isclose(d, wanted, rel_tol=_SAME_BALL)]
    if not chosen:
        there = ", ".join(f"{each * 1e3:g} mm" for each in sorted(balls)) or "none"
        raise ConfigError(
            f"{run.store.paths.root}: optics are calibrated from presses of one ball; balls of "
            f"this run: {there}",
            remedy="give a run with presses of a ball, or --ball-diameter where it does not say so",
        )
    diameter = max(chosen, key=lambda each: len(balls[each]))
    read = {index: run.attempt(index) for index in balls[diameter]}
    seen = {i: each for i, each in read.items() if each is not None and each.images is not None}
    if not seen:
        raise RecordError(
            f"{run.store.paths.root}: no press of the ball has images without contact and with it",
            remedy="`tacauchy-rig report` says what is missing",
        )
    return diameter, seen


def _write_presses(run: RunReading, presses: Mapping[int, AttemptReading]) -> dict[str, int]:
    """Write presses as ``calibrate optics`` takes them, and return their trials by file name.

    Circles are written where every press has one; otherwise the contacts are found.
    """
    folder = _presses_folder(run)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    names, rows = _image_names(run, presses), [CIRCLE_COLUMNS]
    for index, attempt in presses.items():
        if attempt.images is not None:
            write_atomically(folder / names[index], encode_png(attempt.images.real))
        if (circle := _circle(attempt)) is not None:
            column, row, radius = (f"{value:.3f}" for value in circle)
            rows.append((names[index], column, row, radius))
    unloaded = [each.reference for each in presses.values() if each.reference is not None]
    write_atomically(folder / NO_CONTACT, encode_png(median_image(unloaded)))
    if len(rows) == 1 + len(presses):
        write_atomically(folder / CIRCLES, as_csv(rows))
    return {name: index for index, name in names.items()}


def _presses_folder(run: RunReading) -> Path:
    return run.store.paths.optics / "presses"


def _image_names(run: RunReading, trials: Iterable[int]) -> dict[int, str]:
    """Return a PNG's name for each trial: the source's own name of the image, where it has one."""
    names: dict[int, str] = {}
    for index in trials:
        imported = run.store.imported_trials.get(index)
        stem = "" if imported is None else Path(imported.image.replace("\\", "/")).stem
        name = f"{stem}.png" if _PLAIN_NAME.fullmatch(stem) else f"{index:03d}.png"
        taken = name in names.values() or name == NO_CONTACT
        names[index] = f"{index:03d}-{name}" if taken else name
    return names


def _circle(attempt: AttemptReading) -> tuple[float, float, float] | None:
    """Return the circle drawn into a press's image, in pixels of the scored image."""
    imported = attempt.store.imported_trials.get(attempt.record.index)
    frame = next(iter(attempt.recording.frames()), None)
    if imported is None or imported.contact_px is None or frame is None:
        return None
    geometry = attempt.geometry
    column, row, radius = imported.contact_px
    left, top = (int(n * geometry.crop_fraction) for n in (frame.width, frame.height))
    across = geometry.width_px / (frame.width - 2 * left)
    down = geometry.height_px / (frame.height - 2 * top)
    # Pixel (0, 0) is the centre of the first pixel, so that its border is at -0.5.
    return (
        (column - left + 0.5) * across - 0.5,
        (row - top + 0.5) * down - 0.5,
        radius * float(np.sqrt(across * down)),
    )


def _agreement(scores: PressScores) -> ImageAgreement:
    return ImageAgreement(
        r2=scores.r2,
        mae_levels=scores.mae,
        ssim=scores.ssim_crop,
        r2_no_contact=scores.r2_no_contact,
        mae_no_contact_levels=scores.mae_no_contact,
        ssim_no_contact=scores.ssim_crop_no_contact,
    )


def _held_out(row: Mapping[str, Any], trials: Mapping[str, int]) -> HeldOutPress:
    labelled, nudged = (tuple(row[key].values()) for key in ("labelled", "nudged"))
    return HeldOutPress(
        trial=trials[row["image"]],
        contact_px=labelled,
        nudged_px=tuple(new - old for new, old in zip(nudged, labelled, strict=True)),
        mae_levels=row["held_out_mae_levels"],
    )
