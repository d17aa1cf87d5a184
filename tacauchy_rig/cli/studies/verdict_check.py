"""``tacauchy-rig verdict-check``: the report of a run against replays that are wrong on purpose."""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig import __version__
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import say, show_table, write_json, write_text


def verdict_check(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="Replayed runs: the first is replayed wrongly, of all the true.",
            exists=True,
            file_okay=False,
        ),
    ],
    preset: Annotated[
        Preset, typer.Option("--preset", help="Of the wrong replays; what is cheap will do.")
    ] = Preset.FAST,
    only: Annotated[str, typer.Option("--only", metavar="PATTERN", help="Such as 'gel*'.")] = "*",
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path("docs/verdict_check.md"),
    json_file: JsonFile = None,
) -> None:
    """Say which wrong models the verdict catches, and the smallest change of each that it does."""
    from reports.comparison.compare import compare
    from tacauchy_rig.cli.emulation import emulated_calibration
    from tacauchy_rig.loop.opening import open_run
    from tacauchy_rig.loop.optics import optics_of
    from tacauchy_rig.loop.replay import inputs_of
    from tacauchy_rig.loop.report import evidence_of
    from tacauchy_rig.verdict_check.bench import bench_of
    from tacauchy_rig.verdict_check.check import check_model
    from tacauchy_rig.verdict_check.page import check_page, true_table, wrong_table
    from tacauchy_rig.verdict_check.wrong_models import WRONG_MODELS

    runs = [open_run(folder) for folder in folders]
    first = runs[0]
    names = [f"seed {run.store.description.get('seed')}" for run in runs]
    reports = [
        (f"{name}, own replay", compare(evidence_of(run)))
        for name, run in zip(names, runs, strict=True)
    ]
    inputs = replace(inputs_of(first.store.config), preset=preset, tolerance=None)
    optics = optics_of(
        first.store.config.sensor.optics_calibration,
        inputs.sensor,
        calibrate=emulated_calibration(first.store),
        on_progress=say,
    )
    bench = bench_of(first, inputs, optics)
    reports.insert(1, (f"{names[0]}, preset {preset.value}", compare(bench.evidence())))
    findings = []
    for model in WRONG_MODELS:
        if fnmatch(model.name, only):
            found = check_model(bench, model)
            findings.append(found)
            smallest = f"; from {found.smallest:.3g} {model.unit} on" if found.smallest else ""
            say(f"{model.name}: {', '.join(found.caught_by) or 'not caught'}{smallest}")
    uncertainty = f"{100.0 * inputs.sensor.young_uncertainty()[0]:.0f} %"
    true, wrong = true_table(reports), wrong_table(findings, uncertainty=uncertainty)
    show_table(true)
    show_table(wrong)
    write_text(
        out,
        check_page(
            true,
            wrong,
            command=" ".join(["tacauchy-rig verdict-check", *["RUN"] * len(runs)]),
            preset=preset.value,
            version=__version__,
        ),
    )
    write_json(json_file, {"true": true, "wrong": wrong})
    say(f"page {out}")
    raise typer.Exit(0 if true.passed and wrong.passed else 1)
