"""``tacauchy-rig sweep``: a data set of many simulated presses from a plan."""

from __future__ import annotations

from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli import output
from tacauchy_rig.app.sweep.engine_names import EngineName
from tacauchy_rig.core.errors import ConfigError, command_line
from tacauchy_rig.core.time_limit_and_progress import doing

if TYPE_CHECKING:
    from tacauchy_rig.app.sweep.engines import Engine

_PACKAGE = "tacauchy_rig.app.sweep"


def sweep(
    plan_file: Path | None = None,
    *,
    out: Path | None = None,
    engine: EngineName = EngineName.LOCAL,
    jobs: output.Jobs = 1,
    address: str | None = None,
    limit: Annotated[int | None, typer.Option(min=1)] = None,
    sample: Annotated[int | None, typer.Option(min=1)] = None,
    dry_run: bool = False,
    slurm: Annotated[int | None, typer.Option(min=1)] = None,
    example: bool = False,
) -> output.Found | None:
    """Simulate the presses of a plan into a data set; only missing presses are computed.

    Example: tacauchy-rig sweep plan.toml --out presses --jobs 2

    Args:
        plan_file (PLAN): A plan's file.
        out (FOLDER): Folder of the data set.
        engine: Where presses are computed.
        address: Address of Dask's scheduler, such as tcp://host:8786.
        limit: Compute only this many presses, the first.
        sample: Compute this many presses, evenly chosen, into FOLDER/sample.
        dry_run: Only print the number of presses, time and space.
        slurm (TASKS): Only write FOLDER/sweep.sbatch for this many tasks.
        example: Print a plan with comments.
    """
    if example:
        typer.echo(resources.files(_PACKAGE).joinpath("example.toml").read_text("utf-8"), nl=False)
        return None
    if plan_file is None or (out is None and not dry_run):
        raise ConfigError(
            "a sweep needs PLAN and --out FOLDER",
            remedy="`tacauchy-rig sweep --example > plan.toml` writes a plan",
        )
    from tacauchy_rig.app.sweep.plan import read_plan, rows_of
    from tacauchy_rig.app.sweep.run_sweep import estimate
    from tacauchy_rig.app.sweep.run_sweep import sweep as run

    plan = read_plan(plan_file)
    with doing("checking the plan"):
        rows = rows_of(plan, limit)
    if sample is not None:
        rows = rows[:: max(1, len(rows) // sample)][:sample]
        out = out and out / "sample"
    processor_s, size_bytes = estimate(plan, rows)
    output.say(
        f"{len(rows)} presses: about {processor_s / 60.0:.1f} min of one core without "
        f"others, {size_bytes / 1e6:.1f} MB"
    )
    if dry_run or out is None:
        return None
    output.writable_folder(out)
    if slurm is not None:
        _write_script(plan_file, out, slurm, limit)
        return None
    with output.Steps() as steps:
        swept = run(plan, rows, out, _engine(engine, out, jobs, address), on_progress=steps)
    if swept.presses:
        spent = ", ".join(f"{part} {seconds:.1f} s" for part, seconds in swept.took_s.items())
        first, most = (value / 1e9 for value in (swept.peaks_bytes[0], max(swept.peaks_bytes)))
        output.say(
            f"{engine}: {swept.presses} presses in {swept.elapsed_s:.1f} s; processes spent {spent}"
            f"; each used at most {most:.2f} GB, {first:.2f} GB for the first shard"
        )
    output.say(
        f"wrote {out / 'summary.html'}" if swept.is_whole else f"{out}: other tasks have the rest"
    )
    return output.Found({"folder": str(out), "engine": engine, **asdict(swept)})


def _engine(name: EngineName, out: Path, jobs: int, address: str | None) -> Engine:
    from tacauchy_rig.app.sweep import engines
    from tacauchy_rig.app.sweep.shards import SHARDS

    if name is EngineName.DASK:
        if address is None:
            raise ConfigError(
                "--engine dask needs --address",
                remedy="start `dask scheduler` and give its address, such as tcp://host:8786",
            )
        return engines.Dask(address)
    if name is EngineName.GPU:
        from sim.device import gpus

        return engines.Processes(gpus() * 2)  # one solves while the other one writes
    if name is EngineName.FOLDER:

        def is_done(shard: str) -> bool:
            return (out / SHARDS / f"{shard}.parquet").exists()

        return engines.Folder(out / "claims", is_done)
    return engines.Processes(["cpu"] * jobs)


def _write_script(plan_file: Path, out: Path, tasks: int, limit: int | None) -> None:
    from jinja2 import Template

    from tacauchy_rig.app.sweep.engines import InterruptedSweepError

    text = resources.files(_PACKAGE).joinpath("sbatch.sh.jinja").read_text("utf-8")
    words = ["sweep", plan_file.resolve(), "--out", out.resolve(), "--engine", "folder"]
    words += [] if limit is None else ["--limit", limit]
    script = out / "sweep.sbatch"
    command, unfinished = command_line(*words), InterruptedSweepError.exit_code
    facts = {"out": out, "script": script, "tasks": tasks, "command": command}
    output.write_text(script, Template(text).render(**facts, unfinished=unfinished) + "\n")
    output.say(f"wrote {script}")
