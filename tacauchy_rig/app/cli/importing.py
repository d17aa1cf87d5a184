"""``import``: others' recordings as a run folder that ``replay`` and ``report`` take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile, Overrides
from tacauchy_rig.app.cli.output import complain, say, write_json
from tacauchy_rig.core.errors import command_line

if TYPE_CHECKING:
    from tacauchy_rig.core.config.model import RigConfig


def import_(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE", help="A folder with import.toml, that file, or the taxim wheel."
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where runs go.")] = Path("runs"),
    init: Annotated[
        bool,
        typer.Option("--init", help="Write the folder's import.toml with guesses, and do no more."),
    ] = False,
    overrides: Overrides = None,
    json_file: JsonFile = None,
) -> None:
    """Make a run folder of others' recordings; what they do not tell stays unknown.

    Example: tacauchy-rig import presses --init, then tacauchy-rig import presses --out runs
    """
    from tacauchy_rig.core.long_task import doing

    if init:
        _init(source)
        return
    with doing("importing"):
        from tacauchy_rig.app.importing.importer import import_run

        store = import_run(source, parent=out, overrides=overrides or (), check=_check)
    imported = store.imported.load()
    if imported is not None:
        say(f"imported {len(imported.trials)} presses from {imported.source} ({imported.kind})")
        for sentence in (*imported.unknown, *imported.notes):
            complain(f"  {sentence}")
    say(f"run folder {store.paths.root}")
    say(f"next: {command_line('calibrate', 'optics', store.paths.root)} if balls were pressed, or")
    say(f"      {command_line('replay', store.paths.root)}")
    write_json(json_file, {"run": str(store.paths.root), "imported": imported})


def _init(folder: Path) -> None:
    from tacauchy_rig.app.importing.guess import write_guess

    written, guesses = write_guess(folder)
    say(f"wrote {written}")
    for question in guesses.asked:
        say(f"  check {question}")
    say(f"next: {command_line('import', folder)}")


def _check(config: RigConfig) -> None:
    """Refuse what nothing can be replayed with; the simulator is only loaded to ask for more."""
    from sim.scene.scene import Drive, Preset

    replay = config.replay
    is_plain = replay.preset in {"auto", *Preset} and replay.drive in set(Drive)
    if not is_plain or replay.tolerance is not None or replay.law is not None:
        from tacauchy_rig.app.replay.inputs import inputs_of

        inputs_of(config)
