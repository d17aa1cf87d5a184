"""Commands that are imported when they are called: a short one need not wait for the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, ClassVar

import typer
from typer.core import TyperGroup


def lazy_group(places: Mapping[str, str]) -> type[TyperGroup]:
    """Return the class of a group of commands.

    Args:
        places: Where each command is, ``module:name`` of its function, or of the ``typer.Typer``
            of a group; in the order of the help.
    """

    class LazyGroup(_LazyGroup):
        """A group of these commands."""

        _places = places

    return LazyGroup


class _LazyGroup(TyperGroup):
    _places: ClassVar[Mapping[str, str]]

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """Return all names, imported or not."""
        return [*self._places, *(n for n in super().list_commands(ctx) if n not in self._places)]

    def get_command(self, ctx: typer.Context, cmd_name: str) -> Any:  # type: ignore[override]
        """Return a command, imported now if need be."""
        # A misspelt name is compared with those of all commands that are there.
        wanted = [cmd_name] if cmd_name in self.list_commands(ctx) else list(self._places)
        for name in wanted:
            if name in self._places and name not in self.commands:
                self.commands[name] = _imported(name, self._places[name])
        return super().get_command(ctx, cmd_name)


def _imported(name: str, place: str) -> Any:
    module, _, attribute = place.partition(":")
    found = getattr(import_module(module), attribute)
    group = found if isinstance(found, typer.Typer) else typer.Typer(add_completion=False)
    if group is not found:
        group.command(name)(found)
    command = typer.main.get_command(group)
    command.name = name
    return command
