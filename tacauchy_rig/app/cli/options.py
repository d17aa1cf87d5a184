"""Options that several commands share, and records of options."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

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
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as JSON.")
]
Jobs = Annotated[int, typer.Option("--jobs", metavar="N", min=1, help="Number of processes.")]


def takes(
    record: type, *, option: Callable[[str], Any] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the fields of a dataclass as options; it takes them as its first argument.

    Typer reads a command's options from its signature, which is put together here.

    Args:
        option: Makes the option of a field, None where it is none; without it options are the
            fields that are annotated with one.
    """
    kinds, shared = get_type_hints(record, include_extras=True), []
    for each in fields(record):
        kind, made = kinds[each.name], option and option(each.name)
        if made is not None:
            kind = Annotated[kind, made]
        if get_origin(kind) is Annotated:
            default = inspect.Parameter.empty if each.default is MISSING else each.default
            keyword = inspect.Parameter.KEYWORD_ONLY
            named = inspect.Parameter(each.name, keyword, default=default, annotation=kind)
            shared.append(named)

    def with_options(command: Callable[..., None]) -> Callable[..., None]:
        _, *own = inspect.signature(command, eval_str=True).parameters.values()

        @wraps(command)
        def called(*args: Any, **options: Any) -> None:
            given = {each.name: options.pop(each.name, each.default) for each in shared}
            command(record(**given), *args, **options)

        named = [*shared, *(each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own)]
        called.__signature__ = inspect.Signature(named)  # type: ignore[attr-defined]
        return called

    return with_options
