"""``tacauchy-rig calibrate material``: modulus, Poisson's ratio and friction from presses."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import Jobs, JsonFile, Overrides
from tacauchy_rig.app.cli.output import say, write_json, write_text
from tacauchy_rig.core.config.uncertainty import stated_uncertainty
from tacauchy_rig.core.quantities import Dimension, parse_quantity

if TYPE_CHECKING:
    from tacauchy_rig.app.calibration.material.fit import GelFit, Interval
    from tacauchy_rig.app.calibration.material.presses import IndenterPresses

ADVISED = 3
"""Number of proposed presses that are shown, the best first."""


def material(
    presses: Annotated[
        list[Path],
        typer.Argument(
            metavar="PRESSES...",
            help="Run folders, or CSV files with indenter,depth_mm,force_n and optionally press.",
        ),
    ],
    sensor: Annotated[
        str | None, typer.Option(help="Sensor of the CSV files; a run states its own.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Sensor file to write, with the fitted gel.")
    ] = None,
    noise: Annotated[
        str, typer.Option(help="Standard deviation of a force in a CSV file.")
    ] = "0.01N",
    contact_force: Annotated[str, typer.Option(help="Force at depth zero in CSV files.")] = "0N",
    overrides: Overrides = None,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Fit E, nu and friction of a gel to forces at known depths, with 95 % intervals.

    Example: tacauchy-rig calibrate material runs/ball runs/punch --out my-sensor.toml
    """
    from tacauchy_rig.app.calibration.material.fit import (
        MU,
        NU,
        YOUNG,
        GelFit,
        contradictions,
        next_presses,
        predict_left_out,
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
        presses, overrides=(*chosen, *(overrides or ())), noise_n=noise_n, contact_force_n=contact_n
    )
    data = []
    for group in groups:
        say(f"{group.name}: {len(group.force_n)} forces; solving")
        data.append((group, respond(group, jobs=jobs)))
        mesh, own = data[-1][1].uncertain
        say(
            "  standard uncertainty of the interpolated forces: "
            f"{mesh:.1%} shared by all, {own:.1%} of each"
        )
        if group.scatter_n is not None:
            say(f"  repeats scatter by {group.scatter_n:.2g} N")
    fit = GelFit(data=data)
    told = [fit.interval(place) for place in (YOUNG, NU, MU)]
    stated = groups[0].inputs.sensor.numbers["material.poisson"]
    rubbing = stated_uncertainty(groups[0].config, "friction").value
    beliefs = {NU: (stated.value, stated.uncertainty), MU: (groups[0].inputs.friction, rubbing)}
    priors = {place: belief for place, belief in beliefs.items() if not told[place].is_bounded}
    _show(fit, told, priors)
    left_out = list(predict_left_out(fit))
    held = sum(each.held for each in left_out)
    say(f"left out and predicted: {held} of {len(left_out)} within their 95 % interval")
    terms = {str(path): relaxation_of(path) for path in presses if path.is_dir()}
    for path, term in terms.items():
        say(f"{path}: {term or 'the dwells show no relaxation'}")
    wrong = contradictions(fit, left_out)
    for sentence in wrong:
        say(sentence)
    advice = [] if wrong else sorted(next_presses(fit), key=lambda each: each.young)
    for each in advice[:ADVISED]:
        say(f"next: {each}")
    if out is not None and not wrong:
        _write(out, GelFit(data=data, priors=priors).best.tolist(), told, groups)
    names = ("young", "poisson", "friction")
    found = {
        "told": dict(zip(names, told, strict=True)),
        "left_out": left_out,
        "next": advice,
        "relaxation": terms,
        "contradictions": wrong,
    }
    write_json(json_file, found)
    raise typer.Exit(1 if wrong else 0)


def _write(
    out: Path, best: list[float], told: list[Interval], groups: list[IndenterPresses]
) -> None:
    """Write the sensor file with E, and nu if it is determined, as they fit the forces together."""
    from tacauchy_rig.app.calibration.material.results import sensor_text, with_gel

    log_young, nu, mu = best[:3]
    young, poisson = (
        replace(found, best=value)
        for found, value in zip(told, (math.exp(log_young), nu), strict=False)
    )
    emulated = ", emulated" if any(group.simulated for group in groups) else ""
    count = f"{sum(len(group.force_n) for group in groups)} forces, {len(groups)} indenters"
    text = sensor_text(groups[0].config.sensor.name)
    source = f"calibrate material{emulated}: {count}; with nu {nu:.4g}, friction {mu:.2g}"
    write_text(out, with_gel(text, young=young, poisson=poisson, source=source))
    say(f"sensor's file {out}; it predicts these forces with replay.friction = {mu:.2g}")


def _show(fit: GelFit, told: list[Interval], priors: dict[int, tuple[float, float]]) -> None:
    say(f"chi^2 {fit.misfit:.1f} of {len(fit.measured)} forces")
    rows = (("modulus E", 1e-6, " MPa"), ("Poisson's ratio nu", 1.0, ""), ("friction mu", 1.0, ""))
    for place, (name, factor, unit) in enumerate(rows):
        assumed = ""
        if place in priors:
            mean, uncertainty = priors[place]
            assumed = f"; the written file assumes {mean:.3g} +- {uncertainty:.2g}"
        say(f"{name:19} {_written(told[place], factor, unit)}{assumed}")
    for presses, zeros_m in fit.zeros():
        shown = ", ".join(f"{1e3 * zero:+.3f}" for zero in zeros_m.tolist())
        say(f"{presses.name}: fitted zeros of depth: add {shown} mm to the depths")


def _written(found: Interval, factor: float, unit: str) -> str:
    low, high = (
        None if end is None else f"{end * factor:.4g}{unit}" for end in (found.low, found.high)
    )
    if low is not None and high is not None:
        return f"{found.best * factor:.4g}{unit}, 95 % from {low} to {high}"
    side = f" (95 %: below {high})" if high else f" (95 %: above {low})" if low else ""
    return f"not determined by these presses{side}"
