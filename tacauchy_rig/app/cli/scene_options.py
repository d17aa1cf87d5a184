"""A scene stated on the command line: the options that ``press`` and ``plan`` share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import wraps
from typing import Annotated, Any, Concatenate, ParamSpec, get_type_hints

import typer

from sim.scene.material import LawName
from sim.scene.scene import Drive, Output, Preset, SceneTerms
from tacauchy_rig.core.registry import Kind, names, unknown

_Own = ParamSpec("_Own")

OutputOption = Annotated[
    list[Output] | None,
    typer.Option(
        "--output",
        metavar="OUTPUT",
        help=f"What else is asked for, of {', '.join(Output)}; may be repeated.",
    ),
]
DeviceOption = Annotated[
    str, typer.Option("--device", help="Where the kernels run: cpu or cuda:0.")
]


def _law(text: str) -> str:
    """Read the name of a law, ours or of another package.

    Raises:
        BadParameter: There is none of that name.
    """
    if unknown(Kind.LAW, text):
        choices = ", ".join(repr(name) for name in names(Kind.LAW))
        raise typer.BadParameter(f"{text!r} is not one of {choices}.")
    return text


_HELP: dict[str, str | None] = {
    "indenter": "cylinder:diameter= (and ,fillet=), sphere:diameter=, plane or mesh:FILE",
    "sensor": "Sensor by name or TOML file.",
    "pad": "box:LxWxHmm, disc:radius=,height= or mesh:FILE,unit=mm",
    "depth": "Travel, such as 0.5mm.",
    "force": "Target, such as 4.7332N.",
    "at": "Where the tip comes down on the pad, such as 1,0.5mm.",
    "shift": "Motion once pressed in, along x, or as 0.3,0.1mm.",
    "twist": "Turn about z once pressed in, such as 5deg.",
    "tilt": "Of the indenter about x and y, such as 2,0deg.",
    "young": "Such as 0.3MPa.",
    "poisson": "Such as 0.48.",
    "layer": "share=, young= and poisson=, joined by commas; once a layer, from the base upwards.",
    "law": f"One of {', '.join(LawName)}, or another package's.",
    "contact": "frictionless, bonded or friction:MU.",
    "duration": "Time that the press takes; 1 s if not given.",
    "preset": f"{', '.join(Preset)}; balanced, unless --tolerance chooses one.",
    "mesh": "Settings of fTetWild, for scenes that it meshes: l_r=, epsilon_r=, stop_energy=, "
    "dihedral_min=; those left out are the preset's.",
    "tolerance": "0.02N or 2%: take the cheapest meshes that keep the corrected F_z within it, or "
    "the depth where --force is given; with --preset, leave out effects within it. shear=5% and "
    "the like, joined by commas, for other outputs.",
    "effect": "Overrule the plan: NAME=on or NAME=off; may be repeated.",
    "drive": f"How a force is reached: {' or '.join(Drive)}.",
}
_FURTHER: dict[str, dict[str, Any]] = {
    "law": {"parser": _law, "metavar": "LAW"},
    "mesh": {"metavar": "NAME=X,"},
    "preset": {"metavar": "PRESET"},
    "drive": {"metavar": "DRIVE"},
    "layer": {"metavar": "LAYER"},
    "tolerance": {"metavar": "2%"},
    "effect": {"metavar": "NAME=on"},
}


def states_a_scene(command: Callable[Concatenate[SceneTerms, _Own], None]) -> Callable[..., None]:
    """Give a command the options of a scene; what they say is its first argument.

    Typer reads a command's options from its signature, which is put together here.
    """
    _, *own = inspect.signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def with_scene(*args: _Own.args, **options: _Own.kwargs) -> None:
        terms: dict[str, Any] = {name: options.pop(name) for name in _HELP}
        command(SceneTerms(**terms), *args, **options)

    signature = inspect.Signature([*_scene_parameters(), *own], return_annotation=None)
    with_scene.__signature__ = signature  # type: ignore[attr-defined]
    return with_scene


def _scene_parameters() -> list[inspect.Parameter]:
    """Return the fields of ``SceneTerms`` that are options."""
    kinds = get_type_hints(SceneTerms)
    return [
        inspect.Parameter(
            each.name,
            inspect.Parameter.POSITIONAL_OR_KEYWORD,
            default=inspect.Parameter.empty if each.default is MISSING else each.default,
            annotation=Annotated[
                kinds[each.name],
                typer.Option(
                    f"--{each.name}", help=_HELP[each.name], **_FURTHER.get(each.name, {})
                ),
            ],
        )
        for each in fields(SceneTerms)
        if each.name in _HELP
    ]
