"""Study "hostile-runs": run folders made to do harm, against every command."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import complain, say, write_json


def hostile_runs(
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="PATTERN", help="Of kinds.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of what is drawn.")] = 1,
    jobs: Jobs = 2,
    json_file: JsonFile = None,
) -> None:
    """Make run folders of every hostile kind, and let every command read each.

    A command fails that changes a file outside, takes a minute of processor time, or meets an
    error that nobody foresaw; `serve` fails, too, if it no longer shows the other run.

    Example: python -m tests.studies hostile-runs --only 'link*'
    """
    from fnmatch import fnmatch

    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.hostile_runs.kinds import all_kinds
    from tests.studies.hostile_runs.observe import observe, recorded

    kinds = [k for k in all_kinds() if not only or any(fnmatch(k, each) for each in only)]
    seen = []
    with tempfile.TemporaryDirectory() as folder:
        look = partial(observe, run=recorded(Path(folder)), seed=seed)
        for kind, found in parallel_map(look, kinds, jobs=jobs, new_process_each=False):
            outcomes = sorted({each.outcome for each in found})
            say(f"{kind[:90]}: {', '.join(outcomes)}; {sum(each.wall_s for each in found):.1f} s")
            for each in found:
                if each.failure:
                    complain(f"  {each.command}: {each.failure[:300]}")
            seen += found
    failed = [each for each in seen if each.failure]
    say(f"{len(kinds)} kinds, {len(seen)} trials of commands: {len(failed)} failed")
    write_json(json_file, {"kinds": len(kinds), "seed": seed, "failed": failed})
    raise typer.Exit(1 if failed else 0)
