"""``import``: others' recordings as a run folder that ``replay`` and ``report`` take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile, Overrides
from tacauchy_rig.app.cli.output import complain, say, write_json


def import_(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE", help="A folder with import.toml, that file, or the taxim wheel."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where runs go.")] = Path(
        "runs"
    ),
    overrides: Overrides = None,
    json_file: JsonFile = None,
) -> None:
    """Make a run folder of others' recordings; what they do not tell stays unknown.

    Example: tacauchy-rig import presses/import.toml --out runs
    """
    from tacauchy_rig.app.importing.importer import import_run
    from tacauchy_rig.app.replay.settings import check_names
    from tacauchy_rig.core.errors import command_line
    from tacauchy_rig.core.long_task import doing

    with doing("importing"):
        store = import_run(source, parent=out, overrides=overrides or (), check=check_names)
    imported = store.imported.load()
    if imported is not None:
        say(f"imported {len(imported.trials)} presses from {imported.source} ({imported.kind})")
        for sentence in (*imported.unknown, *imported.notes):
            complain(f"  {sentence}")
    say(f"run folder {store.paths.root}")
    say(f"next: {command_line('calibrate', 'optics', store.paths.root)} if balls were pressed, or")
    say(f"      {command_line('replay', store.paths.root)}")
    write_json(json_file, {"run": str(store.paths.root), "imported": imported})
