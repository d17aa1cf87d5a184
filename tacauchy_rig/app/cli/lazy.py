"""Commands that are imported when they are called: a short one need not wait for the simulator."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from tacauchy_rig.core.errors import ConfigError


def lazy_group(
    places: Mapping[str, str],
    *,
    panels: Mapping[str, tuple[str, ...]] | None = None,
    moved: Mapping[str, str] | None = None,
) -> type[TyperGroup]:
    """Return the class of a group of commands.

    Args:
        places: Where each command's function is, ``module:name``; in the order of the help.
        panels: By heading, the commands that the help lists below it, groups included; then they
            are listed in this order.
        moved: By a name that was a command once, the command that is to be called instead.
    """

    class LazyGroup(_LazyGroup):
        """A group of these commands."""

        _places, _panels, _moved = places, panels or {}, moved or {}

    return LazyGroup


class _LazyGroup(TyperGroup):
    _places: ClassVar[Mapping[str, str]]
    _panels: ClassVar[Mapping[str, tuple[str, ...]]]
    _moved: ClassVar[Mapping[str, str]]

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for name, place in self._places.items():
            self.commands.setdefault(name, _LazyCommand(name, place))
        for panel, names in self._panels.items():
            for name in names:
                self.commands[name].rich_help_panel = panel  # type: ignore[attr-defined]

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """Return all names in the order of the help; who asks for all wants their help too."""
        for command in self.commands.values():
            if isinstance(command, _LazyCommand):
                command.read_help()
        first = [name for names in self._panels.values() for name in names] or list(self._places)
        return [*first, *(n for n in super().list_commands(ctx) if n not in first)]

    def get_command(self, ctx: typer.Context, cmd_name: str) -> Any:  # type: ignore[override]
        """Return a command; a name that moved is refused with where it went.

        Raises:
            ConfigError: The name moved.
        """
        if cmd_name in self._moved:
            raise ConfigError(
                f"the command {cmd_name} has moved", remedy=f"call {self._moved[cmd_name]}"
            )
        return super().get_command(ctx, cmd_name)


class _LazyCommand(TyperCommand):
    """A command by its name and place; its function is imported when it is to run or to explain."""

    def __init__(self, name: str, place: str) -> None:
        super().__init__(name)
        self._place = place

    def read_help(self) -> None:
        """Take the function's docstring from its source, which imports nothing."""
        self.help = _docstring(self._place)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Return the context of the real command, in which it then runs."""
        return _imported(self.name or "", self._place).make_context(*args, **options)


def _docstring(place: str) -> str:
    module, _, name = place.partition(":")
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ImportError(f"{module} is not there")
    for statement in ast.parse(Path(spec.origin).read_text("utf-8")).body:
        if isinstance(statement, ast.FunctionDef) and statement.name == name:
            return inspect.cleandoc(ast.get_docstring(statement) or "")
    raise ImportError(f"{module} has no function {name}")


def _imported(name: str, place: str) -> Any:
    module, _, attribute = place.partition(":")
    group = typer.Typer(add_completion=False)
    group.command(name)(getattr(import_module(module), attribute))
    command = typer.main.get_command(group)
    command.name = name
    return command
