"""``python -m tests.studies gel``: does a calibration of a gel hold what it says?"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import say, show_table, write_json

if TYPE_CHECKING:
    from tacauchy_rig.app.calibration.material.presses import IndenterPresses
    from tests.studies.gel.emulated_gels import Fitted


def gel_check(
    gels: Annotated[int, typer.Option("--gels", min=1, help="How many are drawn.")] = 10,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    truth: Annotated[Preset, typer.Option("--truth", help="Of the gels.")] = Preset.BALANCED,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Calibrate drawn gels by one indenter and more; count how often the intervals hold them.

    Example: python -m tests.studies gel --gels 10 --jobs 2
    """
    from tacauchy_rig.app.calibration.material.fit import respond
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.gel.emulated_gels import BALL, PUNCH, WIDE, fitted_gel, gel_table, presses_of

    tools, seeds = (BALL, PUNCH, WIDE), range(seed, seed + gels)
    say("pressing with every indenter, nu and friction that a gel may have")
    responses = {tool: respond(presses_of(seed, tool), jobs=jobs) for tool in tools}
    tasks = [(number, tool) for number in seeds for tool in tools]
    presses: dict[int, dict[str, IndenterPresses]] = {}
    work = partial(_pressed, truth=truth)
    for (number, tool), found in parallel_map(work, tasks, jobs=jobs, new_process_each=False):
        say(f"gel {number}: pressed with {tool}")
        presses.setdefault(number, {})[tool] = found
    fitted: list[Fitted] = []
    for number, own in presses.items():
        fitted += fitted_gel(number, own, responses)
    table = gel_table(fitted)
    show_table(table)
    write_json(json_file, {"table": table, "gels": fitted})
    raise typer.Exit(0 if table.passed else 1)


def _pressed(task: tuple[int, str], *, truth: Preset) -> IndenterPresses:
    from tests.studies.gel.emulated_gels import presses_of

    return presses_of(*task, preset=truth)
