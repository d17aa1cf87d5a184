"""Commands that state a scene: the options of ``SceneTerms`` before those of their own."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import wraps
from typing import Annotated, Any, Concatenate, ParamSpec, get_origin, get_type_hints

from tacauchy_rig.cli.scene_options import SceneTerms

_Own = ParamSpec("_Own")


def states_a_scene(command: Callable[Concatenate[SceneTerms, _Own], None]) -> Callable[..., None]:
    """Give a command the options of a scene; what they say is its first argument.

    Typer reads a command's options from its signature, which is put together here.
    """
    shared = _scene_parameters()
    _, *own = inspect.signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def stated(*args: _Own.args, **options: _Own.kwargs) -> None:
        terms: dict[str, Any] = {each.name: options.pop(each.name) for each in shared}
        command(SceneTerms(**terms), *args, **options)

    signature = inspect.Signature([*shared, *own], return_annotation=None)
    stated.__signature__ = signature  # type: ignore[attr-defined]
    return stated


def _scene_parameters() -> list[inspect.Parameter]:
    """Return the fields of ``SceneTerms`` that are options."""
    hints = get_type_hints(SceneTerms, include_extras=True)
    return [
        inspect.Parameter(
            each.name,
            inspect.Parameter.POSITIONAL_OR_KEYWORD,
            default=inspect.Parameter.empty if each.default is MISSING else each.default,
            annotation=hints[each.name],
        )
        for each in fields(SceneTerms)
        if get_origin(hints[each.name]) is Annotated
    ]
