"""Study "mounting": what simulating friction and tilt gains, and how well a tilt is found."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig import __version__
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, show_table, write_json, write_text


def mounting_check(
    folder: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="A recorded dry run.", exists=True, file_okay=False),
    ],
    preset: Annotated[Preset, typer.Option("--preset", help="Of the replays.")] = Preset.BALANCED,
    drawn: Annotated[int, typer.Option("--drawn", help="Worlds whose lean is found.")] = 20,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/mounting_check.md"
    ),
    json_file: JsonFile = None,
) -> None:
    """Replay a run with friction and lean and without, and find the lean of drawn tools.

    Example: python -m tests.studies mounting runs/20261123-dry-run
    """
    from tacauchy_rig.app.cli.emulation import emulated_calibration
    from tacauchy_rig.app.replay.opening import open_run
    from tacauchy_rig.core.page import page
    from tests.studies.mounting.drawn_tools import find_drawn, tilt_ratio, tilt_table
    from tests.studies.verdict.bench import bench_of
    from tests.studies.verdict.mounting import residual_table, residuals_of

    run = open_run(folder)
    config = run.store.config
    tools = find_drawn(range(seed, seed + drawn), config, say)
    calibrate = emulated_calibration(run.store)
    bench = bench_of(run, preset=preset, calibrate=calibrate, on_progress=say)
    residuals, leans = residual_table(residuals_of(bench, say)), tilt_table(tools)
    for table in (residuals, leans):
        show_table(table)
    lean = ", ".join(f"{math.degrees(angle):.2f} deg" for angle in bench.inputs.tilt_rad)
    true = [f'"{math.degrees(angle):g} deg"' for angle in config.emulation.tilt or ()]
    tilt = f" --set 'emulation.tilt=[{', '.join(true)}]'" if true else ""
    facts = {
        "command": f"python -m tests.studies mounting RUN --drawn {drawn} --seed {seed}",
        "version": __version__,
        "settings": f"--set emulation.seed={config.emulation.seed}{tilt}",
        "preset": preset.value,
        "residuals": residuals,
        "lean": f"{lean} towards x and y",
        "drawn": leans,
        "drawn_count": drawn,
        "seed": seed,
        "ratio": tilt_ratio(tools),
    }
    write_text(out, page("tests.studies.verdict", "mounting_check.md.jinja", facts))
    write_json(json_file, {"residuals": residuals, "leans": leans})
    say(f"page {out}")
    raise typer.Exit(0 if residuals.passed and leans.passed else 1)
