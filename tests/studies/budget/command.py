"""``python -m tests.studies budget``: does the budget of a predicted force hold what it says?"""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.options import ConfigFile, Jobs, JsonFile, Overrides
from tacauchy_rig.app.cli.output import say, show_table, write_json


def budget_check(
    config_file: ConfigFile = None,
    overrides: Overrides = None,
    worlds: Annotated[int, typer.Option("--worlds", min=1, help="How many are drawn.")] = 20,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    preset: Annotated[Preset, typer.Option("--preset", help="That predicts.")] = Preset.FAST,
    truth: Annotated[Preset, typer.Option("--truth", help="Of the worlds.")] = Preset.BALANCED,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Draw worlds from stated uncertainties; count how often the 95 % interval holds their force.

    Example: python -m tests.studies budget --worlds 20 --jobs 2
    """
    from tacauchy_rig.core.config.load import load_config
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.budget.worlds import coverage_table, look_at, predict_stated

    config = load_config(config_file, overrides=overrides or ()).config
    say("predicting, and trying what uncertain inputs change")
    stated = predict_stated(config, preset=preset)
    look = partial(look_at, stated=stated, preset=truth)
    found = []
    for number, world in parallel_map(
        look, range(seed, seed + worlds), jobs=jobs, new_process_each=False
    ):
        ratios = ", ".join(f"{ratio:+.2f}" for ratio in world.ratios)
        say(f"world {number}: error / u {ratios}")
        found.append(world)
    table = coverage_table(found, config.protocol.force_targets)
    show_table(table)
    write_json(json_file, {"table": table, "worlds": found})
    raise typer.Exit(0 if table.passed else 1)
