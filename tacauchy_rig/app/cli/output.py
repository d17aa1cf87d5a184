"""What commands share: their options, plain lines, progress on a terminal, JSON on request."""

import inspect
import json
import logging
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self, get_args, get_origin, get_type_hints

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from tacauchy_rig.core.store.atomic_write import writing
from tacauchy_rig.core.tables import Table, terminal_table

logger = logging.getLogger(__name__)

console = Console(highlight=False, soft_wrap=True, emoji=False)
error_console = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def say(text: str = "") -> None:
    """Print one line at once, so that a pipe shows progress too.

    A terminal that was lost takes no line; what goes on must not end because of that.
    """
    _print(console, text)


def complain(text: str) -> None:
    """Print an error, if there is still a terminal to print it on."""
    _print(error_console, text)


def _print(where: Console, text: str) -> None:
    try:
        where.print(text, markup=False)
        where.file.flush()
    except OSError as error:
        logger.debug("not printed (%s): %s", error, text)


def show_table(table: Table) -> None:
    """Print a table as wide as the terminal, with its title and how it went."""
    console.print(terminal_table(table, width=console.width))


def write_json(path: Path | None, content: Any) -> None:
    """Write what a command found to ``--json FILE``; nothing when no file was asked for."""
    if path is None:
        return
    from tacauchy_rig.core.store.json_codec import to_plain

    text = json.dumps(to_plain(content), indent=2, allow_nan=False)
    write_text(path, text + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a page, or whatever an option names the file of."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def writable_folder(path: Path) -> Path:
    """Make a folder for results before they are computed, and return it."""
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    return path


# Its records of a compiled module have ``compiled_s``: see sim/device.py.
_SOURCE = "sim.device.compiled"


@contextmanager
def compilation_told() -> Iterator[None]:
    """Say on standard error that kernels are compiled, and in the end how long all of them took."""
    source, spent_s = logging.getLogger(_SOURCE), list[float]()

    def take(record: logging.LogRecord) -> bool:
        if not spent_s:
            complain("compiling kernels once for this computer; later presses find them")
        spent_s.append(getattr(record, "compiled_s", 0.0))
        return False

    source.addFilter(take)
    source.setLevel(logging.INFO)
    try:
        yield
    finally:
        source.removeFilter(take)
        source.setLevel(logging.NOTSET)
        if spent_s:
            complain(f"compiling kernels once: {sum(spent_s):.0f} s")


class Steps:
    """Shows the steps of a long command; a context.

    On a terminal they are a bar with the seconds left, elsewhere plain lines.
    """

    def __init__(self) -> None:
        self._started = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            console=error_console,
            transient=True,
            disable=not error_console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None, left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def __call__(self, what: str, done: int, total: int, left: str | None = None) -> None:
        """Say what was done, which of how many steps that was, and what is left if it is known."""
        spent_s = time.monotonic() - self._started
        if left is None:
            left = f"about {spent_s / done * (total - done):.0f} s left" if 0 < done < total else ""
        if error_console.is_terminal:
            self._bar.update(self._task, description=what, completed=done, total=total, left=left)
        else:
            complain(f"  {done}/{total} {what}{', ' * bool(left)}{left}")


def _run_folder(folder: Path) -> Path:
    """Refuse what is no run's folder, before a command imports what it works with."""
    from tacauchy_rig.core.store.run_files import run_folder

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


_ENTRY = re.compile(r"(\w+)(?: \((\S+)\))?: (.*)")


def _described(documentation: str | None) -> tuple[str, dict[str, tuple[str, str]]]:
    """Return a docstring before its ``Args``, and the metavar and help of each of those."""
    text, _, listed = inspect.cleandoc(documentation or "").partition("\n\nArgs:")
    entries = re.split(r"\n    (?! )", listed.split("\n\n")[0])[1:]
    found = [_ENTRY.findall(" ".join(entry.split()))[0] for entry in entries]
    return text, {name: (metavar, told) for name, metavar, told in found}


def _told(given: inspect.Parameter, metavar: str, told: str) -> inspect.Parameter:
    """Return a parameter with its metavar and help: an option, if it is given by keyword only."""
    kind, made = given.annotation, typer.Argument()
    if get_origin(kind) is Annotated:
        kind, made = get_args(kind)
    elif given.kind is inspect.Parameter.KEYWORD_ONLY:
        made = typer.Option(f"--{given.name.strip('_').replace('_', '-')}")
    made = copy(made)  # some are shared
    made.help, made.metavar = told, metavar or made.metavar
    return given.replace(annotation=Annotated[kind, made])


class Found(NamedTuple):
    """What a command found, for ``--json FILE``, and whether that is as it should be."""

    content: Any
    passed: bool = True


def documented(command: Callable[..., Any]) -> Callable[..., None]:
    """Give a command's parameters the help that its docstring has of them.

    What stands below ``Args`` as ``name (METAVAR): help`` is an argument, or an option of that name
    where the parameter is given by keyword only; a flag has no opposite. An annotation says what
    else there is to say, such as another name. In place of a parameter that is a dataclass the
    command has those fields of it as options that the dataclass describes likewise or annotates.
    A command that returns what it ``Found`` has the option ``--json``, and ends with 0 or 1.
    """
    text, entries = _described(command.__doc__)
    signature = inspect.signature(command, eval_str=True)
    own = dict(signature.parameters)
    own |= {name: _told(own[name], *entry) for name, entry in entries.items()}
    named: list[inspect.Parameter] = []
    records: dict[str, tuple[Any, list[str]]] = {}
    for each in own.values():
        if isinstance(each.annotation, type) and is_dataclass(each.annotation):
            options = _options(each.annotation)
            records[each.name] = each.annotation, [option.name for option in options]
            named += options
        else:
            named.append(each)
    keyword = inspect.Parameter.KEYWORD_ONLY
    if records:  # arguments may follow the options of a dataclass
        named = [each.replace(kind=keyword) for each in named]
    finds = Found in (signature.return_annotation, *get_args(signature.return_annotation))
    if finds:
        named.append(inspect.Parameter("json_file", keyword, default=None, annotation=JsonFile))

    @wraps(command)
    def called(**given: Any) -> None:
        made = {
            name: kind(**{option: given.pop(option) for option in options})
            for name, (kind, options) in records.items()
        }
        json_file = given.pop("json_file") if finds else None
        found = command(**given, **made)
        if isinstance(found, Found):
            write_json(json_file, found.content)
            raise typer.Exit(0 if found.passed else 1)

    called.__doc__ = text
    called.__annotations__ = {each.name: each.annotation for each in named}
    called.__signature__ = inspect.Signature(named)  # type: ignore[attr-defined]
    return called


def _options(record: type) -> list[inspect.Parameter]:
    """Return the options that fields of a dataclass are; Typer fills in the context."""
    kinds, (_, entries) = get_type_hints(record, include_extras=True), _described(record.__doc__)
    found = []
    for each in fields(record):
        default = inspect.Parameter.empty if each.default is MISSING else each.default
        keyword, kind = inspect.Parameter.KEYWORD_ONLY, kinds[each.name]
        option = inspect.Parameter(each.name, keyword, default=default, annotation=kind)
        if each.name in entries:
            found.append(_told(option, *entries[each.name]))
        elif kind is typer.Context or get_origin(kind) is Annotated:
            found.append(option)
    return found
