"""Commands that are imported only when they are called or their help is shown."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
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
        # Misspelt names are compared with these.
        self.commands = {**{name: TyperCommand(name) for name in self._places}, **self.commands}

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """Return all names in the order of the help."""
        first = [name for names in self._panels.values() for name in names]
        return first or super().list_commands(ctx)

    def get_command(self, ctx: typer.Context, cmd_name: str) -> Any:  # type: ignore[override]
        """Return a command; a name that moved is refused with where it went."""
        if cmd_name in self._moved:
            raise ConfigError(
                f"the command {cmd_name} has moved", remedy=f"call {self._moved[cmd_name]}"
            )
        if cmd_name in self._places:
            self.commands[cmd_name] = _imported(cmd_name, self._places[cmd_name])
        command: Any = super().get_command(ctx, cmd_name)
        for panel, names in self._panels.items():
            if cmd_name in names:
                command.rich_help_panel = panel
        return command


def _imported(name: str, place: str) -> Any:
    module, _, attribute = place.partition(":")
    group = typer.Typer(add_completion=False)
    group.command(name)(getattr(import_module(module), attribute))
    command = typer.main.get_command(group)
    command.name = name
    return command
