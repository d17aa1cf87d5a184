"""Study "power-cuts": what a power cut can leave of a run, state by state."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import complain, say, write_json

_TOLD_EVERY = 250


def power_cuts(
    states: Annotated[int, typer.Option("--states", min=1, help="How many are drawn.")] = 5000,
    seed: Annotated[int, typer.Option("--seed", help="Of the states.")] = 1,
    jobs: Jobs = 2,
    json_file: JsonFile = None,
) -> None:
    """Draw states that a power cut can leave; recover each, and resume every fiftieth.

    Example: python -m tests.studies power-cuts --states 5000 --jobs 2
    """
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.power_cuts.observe import observe, recorded_history

    shared = Path("/dev/shm")  # noqa: S108 - where it is there, nothing waits for a disk
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        history = recorded_history(Path(folder))
        look = partial(observe, history=history, seed=seed)
        seen = []
        for _, found in parallel_map(look, range(states), jobs=jobs, new_process_each=False):
            seen.append(found)
            for failure in found.failures:
                complain(f"state {found.number}, cut at {found.cut_s:.2f} s: {failure}")
                complain(f"  {'; '.join(found.said) or 'nothing is torn'}")
            if len(seen) % _TOLD_EVERY == 0:
                say(f"{len(seen)} of {states} states")
    failed = [each for each in seen if each.failures]
    torn = sum(bool(each.said) for each in seen)
    say(
        f"{states} states (seed {seed}), {torn} of them with torn files: {len(failed)} without a "
        "way forward or with a finished recording changed"
    )
    write_json(json_file, {"states": states, "seed": seed, "failed": failed})
    raise typer.Exit(1 if failed else 0)
