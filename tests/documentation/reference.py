"""Parts of pages made from the program: commands, ``rig.toml``, Python names, packages."""

import json
import re
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Any, get_args, get_origin

import typer
from typer.core import TyperGroup

import tacauchy_rig
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.config.field_ranges import ceilings
from tacauchy_rig.core.config.load import example_text, load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.quantities import UNITS, Dimension
from tests.architecture import packages

_BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
_KINDS = {"int": "whole number", "str": "text", "bool": "true or false", "float": "number"}


def commands() -> str:
    """Return every command with its arguments and options, as sections and tables."""
    return "\n".join(_commands(typer.main.get_command(app), "tacauchy-rig", level=3))


def _commands(group: Any, name: str, *, level: int) -> Iterator[str]:
    context, panel = typer.Context(group, info_name=name), None
    for child in group.list_commands(context):
        lazy = group.get_command(context, child)
        if isinstance(found := getattr(lazy, "rich_help_panel", None), str) and found != panel:
            panel = found
            yield f"## {panel}\n"
        command = lazy.make_context(child, [], resilient_parsing=True).command
        said = re.sub(r"^Example: (.*)$", r"Example: `\1`", command.help or "", flags=re.M)
        yield f"{'#' * level} {name} {child}\n\n{said}\n"
        if isinstance(command, TyperGroup):
            yield from _commands(command, f"{name} {child}", level=level + 1)
        else:
            records = [each.get_help_record(context) for each in command.get_params(context)]
            rows = [(f"`{what}`", says) for what, says in filter(None, records) if what != "--help"]
            yield _table(("argument or option", "meaning"), rows)


def rig_toml() -> str:
    """Return every table and key of ``rig.toml``, with kind, range and the dry run's value."""
    return "\n".join(_sections())


def _sections() -> Iterator[str]:
    written, limits = load_config().written, dict(ceilings())
    for name, table in RigConfig.model_fields.items():
        section: Any = table.annotation
        said = re.sub(r"\n +", "\n", section.__doc__).replace("``", "`")
        rows = []
        for key, field in section.model_fields.items():
            ranges = [*_ranges(field)]
            if limit := limits.get(f"{name}.{key}"):
                ranges += [f"at least {limit.least}"] if limit.least else []
                ranges += [f"at most {limit.most}: {limit.because}"] if limit.most else []
            value = written.get(f"{name}.{key}")
            shown = f"`{json.dumps(value)}`" if value not in (None, "") else ""
            rows.append((f"`{key}`", _kind(field), shown, "; ".join(ranges)))
        yield f"## [{name}]\n\n{said}\n"
        yield _table(("key", "value", "in the dry run", "range"), rows)


def _ranges(field: Any) -> Iterator[str]:
    dimension = _dimension(field)
    units = {factor: unit for unit, factor in reversed(UNITS.get(dimension, {"": 1.0}).items())}
    for mark in field.metadata:
        for bound, word in _BOUNDS.items():
            if hasattr(mark, bound):
                yield f"{word} {getattr(mark, bound):.10g} {units[1.0]}".strip()


def _kind(field: Any) -> str:
    """Return what a value is: a dimension, a closed set, or a plain type."""
    kinds = [field.annotation, *get_args(field.annotation)]
    if dimension := _dimension(field):
        return f"list of {dimension}s" if get_origin(field.annotation) is tuple else dimension
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, StrEnum):
            return " or ".join(f"`{each}`" for each in kind)
    names = [getattr(kind, "__name__", "") for kind in kinds]
    return next((_KINDS[name] for name in names if name in _KINDS), "table")


def _dimension(field: Any) -> Dimension | None:
    marks = [*field.metadata, *_marks(field.annotation)]
    return next((mark for mark in marks if isinstance(mark, Dimension)), None)


def _marks(annotation: Any) -> Iterator[Any]:
    yield from getattr(annotation, "__metadata__", ())
    for argument in get_args(annotation):
        yield from _marks(argument)


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    cells = (" | ".join(" ".join(cell.split()) for cell in line) for line in lines)
    return "\n".join([*(f"| {line} |" for line in cells), ""])


def example() -> str:
    """Return the commented example for a real rig."""
    return f"```toml\n{example_text().strip()}\n```"


def public_names() -> str:
    """Return a reference of each name that ``tacauchy_rig`` exports."""
    names = sorted((n for n in tacauchy_rig.__all__ if not n.startswith("_")), key=str.lower)
    found = [(name, getattr(tacauchy_rig, name)) for name in names]
    return "\n".join(
        f"::: {value.__module__}.{value.__qualname__}\n    options:\n      heading: {name}\n"
        for name, value in found
    )


PARTS: dict[str, Callable[[], str]] = {
    "commands": commands,
    "rig_toml": rig_toml,
    "example": example,
    "public_names": public_names,
    "packages": packages,
}
"""By the name that a page has them under."""
