"""Study "verdict": the report of a run against replays that are wrong on purpose."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig import __version__
from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import say, show_table, write_json, write_text
from tacauchy_rig.core.selection import selected

if TYPE_CHECKING:
    from tests.studies.verdict.bench import Bench
    from tests.studies.verdict.check import Look, Task


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
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="PATTERN", help="Such as 'gel*'; may be repeated."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/verdict_check.md"
    ),
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Say which wrong models the verdict catches, and the smallest change of each that it does."""
    from tacauchy_rig.app.cli.emulation import emulated_calibration
    from tacauchy_rig.app.replay.opening import open_run
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.verdict.bench import bench_of
    from tests.studies.verdict.check import findings_of, tasks_of, true_reports
    from tests.studies.verdict.page import check_page, true_table, wrong_table
    from tests.studies.verdict.wrong_models import WRONG_MODELS

    runs = [open_run(folder) for folder in folders]
    calibrate = emulated_calibration(runs[0].store)
    bench = bench_of(runs[0], preset=preset, calibrate=calibrate, on_progress=say)
    tasks = tasks_of(selected(WRONG_MODELS, only or [], names=lambda m: (m.name,), kind="model"))
    say(f"{len(tasks)} sizes of wrong models, {jobs} at once")
    findings = findings_of(parallel_map(partial(_looked, bench=bench), tasks, jobs=jobs))
    uncertainty = f"{100.0 * bench.inputs.sensor.young_uncertainty()[0]:.0f} %"
    true = true_table(true_reports(runs, bench))
    wrong = wrong_table(findings, uncertainty=uncertainty)
    show_table(true)
    show_table(wrong)
    command = " ".join(["python -m tests.studies verdict", *["RUN"] * len(runs)])
    facts = {"command": command, "preset": preset.value, "version": __version__}
    write_text(out, check_page(true, wrong, **facts))
    write_json(json_file, {"true": true, "wrong": wrong})
    say(f"page {out}")
    raise typer.Exit(0 if true.passed and wrong.passed else 1)


def _looked(task: Task, *, bench: Bench) -> Look:
    """Look at one size of a wrong model, and say at once what was found."""
    from tests.studies.verdict.check import look_at

    model, size = task
    look = look_at(task, bench=bench)
    sized = f", {size:.3g} {model.unit}" if size else ""
    say(f"{model.name}{sized}: {', '.join(look.missed) or 'not caught'} [{look.seconds:.0f} s]")
    return look
