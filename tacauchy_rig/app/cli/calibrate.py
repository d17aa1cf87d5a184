"""``tacauchy-rig calibrate``: optics, scale, the gel's material, and the delays of streams."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli import output
from tacauchy_rig.core.errors import ConfigError, command_line
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.time_limit_and_progress import doing

if TYPE_CHECKING:
    from sim.optics.calibrate.cross_validation import RenderedPress
    from sim.optics.calibrate.pixel_scale import ScaleFit
    from sim.sensor.sensor import Sensor
    from tacauchy_rig.app.calibration.material.fit_and_next_presses import GelFit, Interval
    from tacauchy_rig.app.calibration.material.measured_presses import IndenterPresses
    from tacauchy_rig.app.calibration.optics.from_folder import OpticsResult


def latency(
    path: Path | None = None,
    *,
    sway: str = "12s",
    force: str = "2N",
    overrides: output.Overrides = None,
) -> output.Found:
    """Press once, sway up and down, and print the delay of force and image against the arm.

    Example: tacauchy-rig calibrate latency rig.toml --json latency.json

    Args:
        path (CONFIG|RUN): A rig.toml to press with, or a run with sway; the dry run's if absent.
        sway: Duration of the sway.
        force: Force to press to before the sway.
    """
    from tacauchy_rig.app.calibration.latency import find_latency
    from tacauchy_rig.app.cli.run_and_resume import recorded

    swaying = (f'protocol.force_targets=["{force}"]', f'protocol.sway="{sway}"')
    store = recorded(path, [*(overrides or ()), *swaying, 'run.name="latency"'])
    found = find_latency(store)
    for name, each in (("force", found.force), ("image", found.image)):
        count = each.stale_count
        stale = f"; {count} more show another moment and are left out" if count else ""
        output.say(
            f"{name} is {each.delay_s * 1e3:+.2f} ms behind the arm, standard uncertainty "
            f"{each.uncertainty_s * 1e3:.2f} ms ({each.sample_count} samples, motion explains "
            f"{each.explained:.1%}{stale})"
        )
    worst_s = math.hypot(found.force.uncertainty_s, found.image.uncertainty_s)
    output.say("for rig.toml:")
    output.say(f'[force_sensor]\ndelay = "{found.force.delay_s * 1e3:.2f} ms"')
    output.say(f'[camera]\ndelay = "{found.image.delay_s * 1e3:.2f} ms"')
    output.say(f'[uncertainty]\ndelay = "{worst_s * 1e3:.2f} ms"')
    if found.trigger_missed:
        output.complain(found.trigger_missed)
    content = {"run": str(store.paths.root), "latency": found}
    return output.Found(content, passed=not found.trigger_missed)


@doing("fitting the scale")
def scale(
    image: Path | None = None,
    *,
    target: str | None = None,
    presses: Path | None = None,
    sensor: str | None = None,
    ball_diameter: str | None = None,
) -> output.Found:
    """Fit mm per pixel in x and y, rotation and centre of a camera.

    Example: tacauchy-rig calibrate scale target.png --target dots:columns=7,rows=5,pitch=2mm

    Args:
        image ([IMAGE]): Image of a target on the gel.
        target: charuco:columns=8,rows=6,square=2mm,marker=1.5mm[,dictionary=4X4_50],
            aruco:columns=5,rows=4,marker=2mm,gap=0.5mm or dots:columns=7,rows=5,pitch=2mm
        presses: Folder with positions.csv (image, x_m, y_m), circles.csv and the images.
        sensor: Crop and resize the raw image of a target as this sensor's camera does; without it
            the image is taken as it is. With --presses: whose dome the ball touches.
        ball_diameter (LENGTH): Of the ball of --presses on a dome.
    """
    from sim.sensor.sensor import load_sensor

    if presses is not None and (sensor is None) != (ball_diameter is None):
        raise ConfigError(
            "--presses needs both --sensor and --ball-diameter, or neither",
            remedy="give both for a domed gel: a ball touches it nearer to its middle",
        )
    known = None if sensor is None else load_sensor(sensor)
    if presses is not None and image is None and target is None:
        fit, points = _from_presses(presses, known, ball_diameter)
    elif presses is None and image is not None and target is not None:
        fit, points = _from_target(image, target, known)
    else:
        raise ConfigError(
            "calibrate scale needs an image with --target, or --presses",
            remedy="tacauchy-rig calibrate scale target.png --target "
            "charuco:columns=8,rows=6,square=2mm,marker=1.5mm",
        )
    _show_scale(fit, points)
    geometry = fit.geometry
    seen = ("rotation_rad", "mirrored", "centre_x_px", "centre_y_px")
    fitted = ("rotation_error_rad", "centre_error_px", "shear_rad", "residual_px")
    found = {
        "scale_x_m_px": geometry.scale_x_m,
        "scale_y_m_px": geometry.scale_y_m,
        "scale_error_m_px": list(fit.scale_error_m),
        **{name: getattr(geometry, name) for name in seen},
        **{name: getattr(fit, name) for name in fitted},
        "width_px": geometry.width,
        "height_px": geometry.height,
        "points": points,
    }
    return output.Found(found)


def _from_target(image: Path, text: str, sensor: Sensor | None) -> tuple[ScaleFit, str]:
    from reports.evidence.frames_and_curves import crop_and_resize
    from sim.optics.calibrate.ball_press import read_rgb
    from sim.optics.calibrate.pixel_scale import find_target, fit_scale, parse_target
    from tacauchy_rig.app.replay.open_run import scored_geometry
    from tacauchy_rig.core.image_codec import to_grey

    seen = read_rgb(image)
    if sensor is not None:
        seen = crop_and_resize(seen, scored_geometry(sensor))
    grey = to_grey(seen)
    found = find_target(parse_target(text), grey, name=str(image))
    fit = fit_scale(found.positions_m, found.pixels, width=grey.shape[1], height=grey.shape[0])
    return fit, f"{len(found.pixels)} of {found.wanted} points of the target"


def _from_presses(
    folder: Path, sensor: Sensor | None, ball_diameter: str | None
) -> tuple[ScaleFit, str]:
    """Fit to ball presses; on a dome of radius R a ball of radius r at x touches at x R/(R + r)."""
    import numpy as np

    from sim.optics.calibrate.ball_press import read_ball_presses
    from sim.optics.calibrate.pixel_scale import fit_scale, read_positions

    places = read_positions(folder / "positions.csv")
    known = [p for p in read_ball_presses(folder, folder / "circles.csv") if p.name in places]
    if not known:
        raise ConfigError(
            f"{folder}: no image of circles.csv is in positions.csv",
            remedy="name the same images in both",
        )
    reach, errors = np.ones(2), np.zeros(2)
    if sensor is not None and ball_diameter is not None:
        ball_m = 0.5 * parse_quantity(
            ball_diameter, dimension=Dimension.LENGTH, field="--ball-diameter"
        )
        for axis, name in enumerate(("pad.dome_radius_x", "pad.dome_radius_y")):
            if (dome := sensor.numbers.get(name)) is not None:
                reach[axis] = dome.value / (dome.value + ball_m)
                errors[axis] = dome.uncertainty * ball_m / (dome.value + ball_m) ** 2
    else:
        output.say("taken as flat: for a domed gel give --sensor and --ball-diameter")
    height, width = known[0].image.shape[:2]
    fit = fit_scale(
        reach * np.array([places[press.name] for press in known]),
        np.array([(press.circle.x_px, press.circle.y_px) for press in known]),
        width=width,
        height=height,
    )
    scales = np.array([fit.geometry.scale_x_m, fit.geometry.scale_y_m])
    x_m, y_m = np.hypot(fit.scale_error_m, errors * scales).tolist()
    return replace(fit, scale_error_m=(x_m, y_m)), f"{len(known)} presses"


def _show_scale(fit: ScaleFit, points: str) -> None:
    geometry = fit.geometry
    off_x = geometry.centre_x_px - 0.5 * (geometry.width - 1)
    off_y = geometry.centre_y_px - 0.5 * (geometry.height - 1)
    size = f"{geometry.width} x {geometry.height} px"
    output.say(f"from {points}, residual {fit.residual_px:.2f} px rms in an image of {size}")
    scales = tuple(
        zip("xy", (geometry.scale_x_m, geometry.scale_y_m), fit.scale_error_m, strict=True)
    )
    for axis, value, error in scales:
        output.say(
            f"scale {axis}    {value * 1e3:.5f} mm/px +- {error / value:.2%}, "
            f"{1e-3 / value:.3f} px/mm"
        )
    output.say(
        f"rotation   {math.degrees(geometry.rotation_rad):.3f} +- "
        f"{math.degrees(fit.rotation_error_rad):.3f} deg{', mirrored' * geometry.mirrored}, "
        f"axes {math.degrees(fit.shear_rad):.3f} deg from a right angle"
    )
    output.say(
        f"centre     column {geometry.centre_x_px:.2f}, row {geometry.centre_y_px:.2f} "
        f"(+- {fit.centre_error_px:.2f} px), {off_x:.2f}, {off_y:.2f} px from the image's middle"
    )
    output.say("for the sensor's file:")
    for axis, value, error in scales:
        output.say(_sensor_line(f"pixel_{axis}", value, error))
    for (axis, value, _), off in zip(scales, (off_x, off_y), strict=True):
        output.say(_sensor_line(f"centre_{axis}", -off * value, fit.centre_error_px * value))


def _sensor_line(key: str, value_m: float, error_m: float) -> str:
    return (
        f'{key} = {{ value = "{value_m * 1e3:.5f} mm", '
        f'uncertainty = "{max(error_m * 1e3, 1e-5):.5f} mm", source = "calibrate scale" }}'
    )


ADVISED = 3
"""Number of proposed presses that are shown, the best first."""


@doing("fitting the gel's material")
def material(
    presses: list[Path],
    *,
    sensor: str | None = None,
    out: Path | None = None,
    noise: str = "0.01N",
    contact_force: str = "0N",
    overrides: output.Overrides = None,
    jobs: output.Jobs = 1,
) -> output.Found:
    """Fit E, nu and friction of a gel to forces at known depths, with 95 % intervals.

    Example: tacauchy-rig calibrate material runs/ball runs/punch --out my-sensor.toml

    Args:
        presses (PRESSES...): Run folders, or CSV files with indenter,depth_mm,force_n and
            optionally press.
        sensor: Sensor of the CSV files; a run states its own.
        out: Sensor file to write, with the fitted gel.
        noise: Standard deviation of a force in a CSV file.
        contact_force: Force at depth zero in CSV files.
    """
    from tacauchy_rig.app.calibration.material import fit_and_next_presses as fitting
    from tacauchy_rig.app.calibration.material.measured_presses import read_presses
    from tacauchy_rig.app.calibration.material.relaxation_and_sensor_file import relaxation_of

    noise_n, contact_n = (
        parse_quantity(text, dimension=Dimension.FORCE, field=field)
        for text, field in ((noise, "--noise"), (contact_force, "--contact-force"))
    )
    chosen = () if sensor is None else (f'sensor.name="{sensor}"',)
    groups = read_presses(
        presses, overrides=(*chosen, *(overrides or ())), noise_n=noise_n, contact_force_n=contact_n
    )
    data = []
    for group in groups:
        output.say(f"{group.name}: {len(group.force_n)} forces; solving")
        data.append((group, fitting.respond(group, jobs=jobs)))
        mesh, own = data[-1][1].uncertain
        output.say(
            "  standard uncertainty of the interpolated forces: "
            f"{mesh:.1%} shared by all, {own:.1%} of each"
        )
        if group.scatter_n is not None:
            output.say(f"  repeats scatter by {group.scatter_n:.2g} N")
    fit = fitting.GelFit(data=data)
    told = [fit.interval(place) for place in (fitting.YOUNG, fitting.NU, fitting.MU)]
    written, young, poisson = fitting.gel_to_write(fit, told)
    _show_gel(fit, told)
    mu, stated = float(written.best[fitting.MU]), written.priors.items()
    assumed = [f"{'nu' if k == fitting.NU else 'mu'} {m:.3g} +- {u:.2g}" for k, (m, u) in stated]
    if assumed:
        output.say(f"with {' and '.join(assumed)} as stated, E is {_written(young, 1e-6, ' MPa')}")
    if poisson.uncertainty and not told[fitting.NU].uncertainty:
        output.say(
            f"the presses exclude the sensor's nu; in its place {_written(poisson, 1.0, '')}"
        )
    left_out = list(fitting.predict_left_out(fit))
    if left_out:
        held = sum(each.held for each in left_out)
        output.say(f"left out and predicted: {held} of {len(left_out)} within their 95 % interval")
    terms = {str(path): relaxation_of(path) for path in presses if path.is_dir()}
    for path, term in terms.items():
        output.say(f"{path}: {term or 'the dwells show no relaxation'}")
    if not terms:
        output.say("relaxation: unknown, a table has no times; record a run with protocol.dwell")
    wrong = fitting.contradictions(fit, left_out)
    note = None if wrong else fitting.other_unit(fit)
    for sentence in [*wrong, *([f"note: {note}"] if note else [])]:
        output.say(sentence)
    advice = [] if wrong else fitting.next_presses(fit)
    for each in advice[:ADVISED]:
        output.say(f"next: {each}")
    if out is not None and not wrong:
        _write(out, mu, young, poisson, groups)
    found = {
        "told": dict(zip(("young", "poisson", "friction"), told, strict=True)),
        "written": {"young": young, "poisson": poisson.best, "friction": mu},
        "left_out": left_out,
        "next": advice,
        "relaxation": terms,
        "contradictions": wrong,
    }
    return output.Found(found, passed=not wrong)


def _write(
    out: Path, mu: float, young: Interval, poisson: Interval, groups: list[IndenterPresses]
) -> None:
    """Write the sensor file with E, and nu if it is bounded, as they fit the forces together."""
    from tacauchy_rig.app.calibration.material import relaxation_and_sensor_file as file

    emulated = ", emulated" if any(group.simulated for group in groups) else ""
    count = f"{sum(len(group.force_n) for group in groups)} forces, {len(groups)} indenters"
    text = file.sensor_text(groups[0].config.sensor.name)
    source = f"calibrate material{emulated}: {count}; with nu {poisson.best:.4g}, friction {mu:.2g}"
    output.write_text(out, file.with_gel(text, young=young, poisson=poisson, source=source))
    output.say(f"sensor's file {out}; it predicts these forces with replay.friction = {mu:.2g}")


def _show_gel(fit: GelFit, told: list[Interval]) -> None:
    output.say(f"chi^2 {fit.misfit:.1f} of {len(fit.measured)} forces")
    rows = (("modulus E", 1e-6, " MPa"), ("Poisson's ratio nu", 1.0, ""), ("friction mu", 1.0, ""))
    for found, (name, factor, unit) in zip(told, rows, strict=True):
        output.say(f"{name:19} {_written(found, factor, unit)}")
    for name, zero_m in zip(fit.series_names, fit.zeros_m.tolist(), strict=True):
        output.say(f"{name}: fitted zero of depth: add {zero_m * 1e3:+.3f} mm to the depths")


def _written(found: Interval, factor: float, unit: str) -> str:
    low, high = (
        None if end is None else f"{end * factor:.4g}{unit}" for end in (found.low, found.high)
    )
    if low is not None and high is not None:
        return f"{found.best * factor:.4g}{unit}, 95 % from {low} to {high}"
    side = f" (95 %: below {high})" if high else f" (95 %: above {low})" if low else ""
    return f"not determined by these presses{side}"


@doing("calibrating optics")
def optics(
    folder: Path,
    *,
    background: Path | None = None,
    ball_diameter: str | None = None,
    scale: str | None = None,
    out: Path | None = None,
    circles: Path | None = None,
    check: Path | None = None,
    sensor: str | None = None,
    preset: Preset = Preset.BALANCED,
    folds: Annotated[int, typer.Option(min=2)] = 7,
    outputs: Path | None = None,
    jobs: output.Jobs = 2,
) -> output.Found:
    """Fit the optics to ball presses, cross-validate, and write a calibration file.

    Example: tacauchy-rig calibrate optics presses --ball-diameter 4.70mm --out optics.npz

    Args:
        folder (FOLDER): Images of a pressed ball, or a run of one.
        background: Frame without contact; in FOLDER or a path.
        ball_diameter: Such as 4.70mm; a run states its own.
        scale: Such as 19.58px/mm, or for x and y 19.6,19.4px/mm; a run's sensor states its own.
        out: Calibration file to write (.npz).
        circles: CSV: image, center_x_px, center_y_px, radius_px; in FOLDER or a path. Without it
            FOLDER's circles.csv, and where there is none the contacts are found.
        check: Folder of other presses to score, labelled or not, as FOLDER's are.
        sensor: Sensor whose pad is pressed: the run's, else gelsight-mini.
        preset: Preset that simulates the presses.
        folds: Folds of the cross-validation.
        outputs (DIR): Write each press as rendered by a model not fitted to it, for `judge`.
    """
    from tacauchy_rig.app.calibration.optics.from_folder import calibrate_and_check
    from tacauchy_rig.app.calibration.optics.from_run import keep_optics, request_of
    from tacauchy_rig.app.judging.task_and_baseline import check_empty
    from tacauchy_rig.app.replay.open_run import open_run

    run = open_run(folder) if (folder / "run.json").is_file() else None
    request = request_of(
        folder,
        run,
        background=background,
        ball_diameter_m=None
        if ball_diameter is None
        else parse_quantity(ball_diameter, dimension=Dimension.LENGTH, field="--ball-diameter"),
        scale_px_m=None if scale is None else _scale(scale),
        out=out,
        sensor=sensor,
        circles=circles,
        check=check,
        preset=preset,
        folds=folds,
        jobs=jobs,
    )
    output.writable_folder(request.out.parent)
    if run is not None:
        others = len(run.records) - len(request.trials)
        output.say(
            f"{len(request.trials)} presses of a ball of {request.ball_diameter_m * 1e3:g} mm"
            + (f"; {others} others of the run are left out" if others else "")
        )
    if outputs is not None:
        check_empty(outputs)
    with output.Steps() as steps:
        result, held_out = calibrate_and_check(request, on_step=steps)
    if outputs is not None:
        _write_outputs(outputs, held_out, folds=folds, trials=request.trials)
    for warning in result.warnings:
        output.complain(f"warning: {warning}")
    _show_optics(result)
    if run is not None:
        keep_optics(run, request, result)
        output.say(f"next: {command_line('replay', folder, '--optics', request.out)}")
    return output.Found(result)


def _write_outputs(
    folder: Path, images: Mapping[int, RenderedPress], *, folds: int, trials: Mapping[str, int]
) -> None:
    """Write presses held out as a simulator's outputs."""
    from tacauchy_rig import __version__
    from tacauchy_rig.app.judging.task_and_baseline import write_outputs
    from tacauchy_rig.core.simulated import Outputs, PressOutput, Simulator
    from tacauchy_rig.core.versions import machine

    simulator = Simulator(
        name="tacauchy_rig's optics",
        version=__version__,
        milliseconds_an_image=1e3 * sum(each.seconds for each in images.values()) / len(images),
        machine=f"cpu, {machine()}, the formula in NumPy",
        note=f"Cross-validated, {folds} folds: of each press nothing is used but its contact's "
        "circle, as drawn or as found in its image, and how its markers say that ball and image "
        "moved and the gel was stretched.",
    )
    presses = {
        trials.get(each.press.name, k): PressOutput(image=each.image)
        for k, each in sorted(images.items())
    }
    write_outputs(folder, Outputs(simulator=simulator, presses=presses))
    output.say(f"wrote {folder}")


def _show_optics(result: OpticsResult) -> None:
    output.say(
        f"coverage   {result.coverage.slopes_seen_share:.0%} of the slopes, "
        f"{result.coverage.image_share:.0%} of the image"
    )
    output.say("                                R2      error   SSIM   ring    (no-contact frame)")
    for name, scores in (("cross-validated", result.cross_validation), ("check", result.check)):
        if scores is None:
            continue
        output.say(f"{name}: {scores.press_count} presses")
        for how, values in (
            ("circles nudged, frame's light", scores),
            ("as given, frame's light", scores.as_labelled),
            ("as given, no-contact light", scores.as_labelled_frames_as_they_came),
        ):
            output.say(
                f"  {how:30}{values.r2:.4f}  {values.mae:5.2f}   {values.ssim_crop:.4f}  "
                f"{values.ring_residual:.3f}  "
                f"({values.r2_no_contact:.2f}, {values.mae_no_contact:.1f}, "
                f"{values.ssim_crop_no_contact:.3f})"
            )
        output.say(
            f"  light {scores.light_rms_levels:.1f} grey levels rms, drift of red, green and blue "
            + ", ".join(f"{level:+.1f}" for level in scores.light_drift_levels)
            + f"; circles moved {scores.nudge_rms_px:.1f} px rms"
        )
        if (moved := scores.camera_moved_px) is not None:
            output.say(f"  camera {moved[0]:+.1f} px to the right, {moved[1]:+.1f} px down")
        if (markers := scores.markers) is not None:
            output.say(
                f"  markers: {markers.tracked} tracked to {markers.tracking_error_px:.2f} px, "
                f"{markers.lost} lost; drawn {markers.error_px:.2f} px "
                f"({markers.error_m * 1e3:.3f} mm) off in the median; at the contact they moved "
                f"{markers.moved_px:.1f} px and are {markers.near_error_px:.2f} px off, nine of "
                f"ten up to {markers.near_error_p90_px:.2f} px"
            )
    for path in result.files:
        output.say(f"wrote {path}")


def _scale(text: str) -> tuple[float, float]:
    from sim.scene.scene_parsing import parse_pair

    x, y = parse_pair(text, Dimension.IMAGE_SCALE, "--scale")
    y = y if "," in text else x
    if not (x > 0.0 and y > 0.0):
        raise ConfigError(f'--scale: "{text}" is not positive', remedy="give one above 0 px/mm")
    return x, y
