"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def _run_folder(folder: Path) -> Path:
    """Refuse what is no run's folder, before a command imports what it works with."""
    from tacauchy_rig.core.store.layout import run_folder

    run_folder(folder)
    return folder


ConfigFile = Annotated[
    Path | None, typer.Argument(metavar="CONFIG", help="A rig.toml; the dry run's if absent.")
]
RequiredConfigFile = Annotated[Path, typer.Argument(metavar="CONFIG", help="A rig.toml.")]
RunFolder = Annotated[
    Path, typer.Argument(metavar="RUN", help="A run's folder.", callback=_run_folder)
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="TABLE.FIELD=VALUE", help="Change one field; may be repeated."),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Write what was found there as JSON."),
]
FigureFolder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the figures go.")]
FigurePage = Annotated[
    Path | None,
    typer.Option(
        "--page",
        metavar="FILE",
        help="Write a page; its figures go to images beside it.",
    ),
]
Jobs = Annotated[
    int,
    typer.Option(
        "--jobs", metavar="N", min=1, help="How many to run at once, each in a process of its own."
    ),
]
