"""Study "residual": whether a planted error is named as the cause of the image residual."""

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
    from reports.scores.residual_split import Cause
    from tests.studies.verdict.bench import Bench
    from tests.studies.verdict.planted import Ranked


def residual_check(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="RUN...", help="Recorded dry runs.", exists=True, file_okay=False),
    ],
    preset: Annotated[Preset, typer.Option("--preset", help="Of the replays.")] = Preset.FAST,
    draws: Annotated[int, typer.Option("--draws", min=1, help="Of each cause and run.")] = 3,
    seed: Annotated[int, typer.Option("--seed", help="Of the first draw.")] = 1,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Causes, such as 'li*'; may be repeated.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/residual_check.md"
    ),
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Replay runs with one known thing wrong, and see whether the split ranks it first.

    Example: python -m tests.studies residual runs/20261123-dry-run
    """
    from tacauchy_rig.app.cli.emulation import emulated_calibration
    from tacauchy_rig.app.replay.opening import open_run
    from tacauchy_rig.core.page import page
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.verdict.bench import bench_of
    from tests.studies.verdict.planted import PLANTS, planted_table

    causes = selected(list(PLANTS), only or [], names=lambda cause: (cause.value,), kind="cause")
    found: list[Ranked] = []
    for folder in folders:
        run = open_run(folder)
        calibrate = emulated_calibration(run.store)
        bench = bench_of(run, preset=preset, calibrate=calibrate, on_progress=say)
        tasks: list[tuple[Cause | None, int]] = [(None, seed)]
        tasks += [(cause, seed + k) for k in range(draws) for cause in causes]
        done = parallel_map(partial(_looked, bench=bench), tasks, jobs=jobs)
        found += [ranked for _, ranked in done if ranked is not None]
    table = planted_table(found)
    show_table(table)
    facts = {
        "command": f"python -m tests.studies residual {' '.join(['RUN'] * len(folders))} "
        f"--preset {preset.value} --draws {draws} --seed {seed}",
        "version": __version__,
        "table": table,
    }
    write_text(out, page("tests.studies.verdict", "residual_check.md.jinja", facts))
    write_json(json_file, {"planted": table})
    say(f"page {out}")
    raise typer.Exit(0 if table.passed else 1)


def _looked(task: tuple[Cause | None, int], *, bench: Bench) -> Ranked | None:
    """Split one replay, and say at once what was found."""
    from tests.studies.verdict.planted import split_planted

    ranked = split_planted(bench, task[0], seed=task[1], on_progress=say)
    if ranked is not None:
        shares = ", ".join(f"{name} {share:.0%}" for name, share in ranked.split.shares.items())
        say(f"{ranked.run}, {ranked.planted}: {shares}")
    return ranked
