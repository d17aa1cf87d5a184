"""A scene stated on the command line: the options that ``press`` and ``plan`` share."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from sim.scene.material import LawName
from sim.scene.scene import Drive, Output, Preset, SceneTerms
from tacauchy_rig.app.cli.options import takes
from tacauchy_rig.core.registry import Kind, names, unknown

OutputOption = Annotated[
    list[Output] | None,
    typer.Option(
        "--output",
        metavar="OUTPUT",
        help=f"What else is asked for, of {', '.join(Output)}; may be repeated.",
    ),
]


def _law(text: str) -> str:
    """Read the name of a law, ours or of another package."""
    if unknown(Kind.LAW, text):
        choices = ", ".join(repr(name) for name in names(Kind.LAW))
        raise typer.BadParameter(f"{text!r} is not one of {choices}.")
    return text


_HELP: dict[str, str] = {
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


def _option(name: str) -> Any:
    if name not in _HELP:
        return None
    return typer.Option(f"--{name}", help=_HELP[name], **_FURTHER.get(name, {}))


states_a_scene = takes(SceneTerms, option=_option)
"""Gives a command the options of a scene; what they say is its first argument."""
