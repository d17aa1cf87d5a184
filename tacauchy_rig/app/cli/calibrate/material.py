"""``tacauchy-rig calibrate material``: modulus, Poisson's ratio and friction from presses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import Jobs, JsonFile, Overrides
from tacauchy_rig.app.cli.output import say, write_json, write_text
from tacauchy_rig.core.quantities import Dimension, parse_quantity

if TYPE_CHECKING:
    from tacauchy_rig.app.calibration.material.fit import GelFit, Interval
    from tacauchy_rig.app.calibration.material.presses import IndenterPresses

ADVISED = 3
"""Next presses that are shown, the best first."""


def material(
    presses: Annotated[
        list[Path],
        typer.Argument(
            metavar="PRESSES...",
            help="Run folders; CSV files of indenter,depth_mm,force_n and perhaps press.",
        ),
    ],
    sensor: Annotated[
        str | None, typer.Option("--sensor", help="Of the CSV files; a run knows its own.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the sensor's file with this gel.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Draw the likelihood: its PDF and PNG.")
    ] = None,
    noise: Annotated[str, typer.Option("--noise", help="Of a force of a CSV file.")] = "0.01N",
    contact_force: Annotated[
        str, typer.Option("--contact-force", help="From which the depths of CSV files count.")
    ] = "0N",
    overrides: Overrides = None,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Fit E, nu and friction of a gel to forces at depths, and say what they leave open.

    Example: tacauchy-rig calibrate material runs/ball runs/punch --out my-sensor.toml
    """
    from tacauchy_rig.app.calibration.material.fit import (
        fit_gel,
        held_count,
        next_presses,
        predict_held_out,
        respond,
    )
    from tacauchy_rig.app.calibration.material.presses import read_presses
    from tacauchy_rig.app.calibration.material.results import relaxation_of

    noise_n, contact_n = (
        parse_quantity(text, dimension=Dimension.FORCE, field=field)
        for text, field in ((noise, "--noise"), (contact_force, "--contact-force"))
    )
    chosen = () if sensor is None else (f'sensor.name="{sensor}"',)
    groups = read_presses(
        presses,
        overrides=(*chosen, *(overrides or ())),
        noise_n=noise_n,
        contact_force_n=contact_n,
    )
    data = []
    for group in groups:
        say(f"{group.name}: {len(group.force_n)} forces; solving")
        data.append((group, respond(group, jobs=jobs)))
    fit = free = fit_gel(data)
    if not free.poisson.is_bounded:
        stated = groups[0].inputs.sensor.numbers["material.poisson"]
        say(
            "the forces leave Poisson's ratio open: the modulus uses the ratio in the sensor's file"
        )
        fit = fit_gel(data, prior=(stated.value, stated.uncertainty))
    _show(free, fit)
    left_out = list(predict_held_out(data, free))
    say("left out and predicted: {} of {} within their 95 % interval".format(*held_count(left_out)))
    terms = {str(path): relaxation_of(path) for path in presses if path.is_dir()}
    for path, term in terms.items():
        say(f"{path}: {term or 'the dwells show no relaxation'}")
    advice = next_presses(data, free)
    for each in advice[:ADVISED]:
        say(f"next: {each}")
    if figure is not None:
        _draw(free, figure, groups)
    if out is not None:
        _write(out, free, fit, groups)
    intervals = {"young": fit.young, "poisson": free.poisson, "friction": free.friction}
    write_json(
        json_file, {"told": intervals, "left_out": left_out, "next": advice, "relaxation": terms}
    )


def _draw(free: GelFit, figure: Path, groups: list[IndenterPresses]) -> None:
    from tacauchy_rig.app.calibration.material.results import draw_valley

    material = groups[0].inputs.sensor.material
    draw_valley(
        free,
        figure.with_suffix(""),
        simulated=any(group.simulated for group in groups),
        stated=(material.young_pa, material.poisson),
    )
    say(f"figure {figure}")


def _write(out: Path, free: GelFit, fit: GelFit, groups: list[IndenterPresses]) -> None:
    from tacauchy_rig.app.calibration.material.results import sensor_text, with_gel

    emulated = ", emulated" if any(group.simulated for group in groups) else ""
    count = f"{free.point_count} forces, {len(groups)} indenters"
    text = sensor_text(groups[0].config.sensor.name)
    source = f"calibrate material{emulated}: {count}"
    write_text(out, with_gel(text, young=fit.young, poisson=free.poisson, source=source))
    say(f"sensor's file {out}")


def _show(free: GelFit, fit: GelFit) -> None:
    least = float(free.misfit.min())
    say(f"chi^2 {least:.1f} of {free.point_count} forces")
    for name, found, factor, unit in (
        ("modulus E", fit.young, 1e-6, " MPa"),
        ("Poisson's ratio nu", free.poisson, 1.0, ""),
        ("friction mu", free.friction, 1.0, ""),
    ):
        say(f"{name:19} {_written(found, factor, unit)}")
    if fit is not free:
        say(f"{'E, whatever nu is':19} {_written(free.young, 1e-6, ' MPa')}")


def _written(found: Interval, factor: float, unit: str) -> str:
    low, high = (
        None if end is None else f"{end * factor:.4g}{unit}" for end in (found.low, found.high)
    )
    if low is None and high is None:
        return "open: any value fits equally well"
    best = f"{found.best * factor:.4g}{unit}"
    if low is None or high is None:
        side = f"below {high}" if low is None else f"above {low}"
        return f"open, except that it is {side} (95 %); best {best}"
    return f"{best}, 95 % from {low} to {high}"
