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
        help=f"An output that gets a stated error: {', '.join(Output)}; may be repeated.",
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
    "depth": "Depth below first touch, such as 0.5mm.",
    "force": "Force to press to, such as 4.7332N.",
    "at": "Position of the tip on the pad, such as 1,0.5mm.",
    "shift": "Motion after the press: along x, or x and y as in 0.3,0.1mm.",
    "twist": "Turn about z after the press, such as 5deg.",
    "tilt": "Tilt of the indenter about x and y, such as 2,0deg.",
    "young": "Young's modulus, such as 0.3MPa.",
    "poisson": "Poisson's ratio, such as 0.48.",
    "layer": "share=, young= and poisson=, joined by commas; one for each layer, from the base up.",
    "law": f"One of {', '.join(LawName)}, or another package's.",
    "contact": "frictionless, bonded or friction:MU.",
    "duration": "Duration of the press; 1 s if absent.",
    "preset": f"{', '.join(Preset)}; balanced, unless --tolerance chooses one.",
    "mesh": "Settings of fTetWild, for scenes that it meshes: l_r=, epsilon_r=, stop_energy=, "
    "dihedral_min=; those left out are the preset's.",
    "tolerance": "0.02N or 2%: take the cheapest meshes that keep the error of the corrected F_z "
    "within it (with --force: of the depth). With --preset it only decides which effects are left "
    "out. For other outputs add shear=5% and the like, joined by commas.",
    "effect": "Switch an effect NAME=on or NAME=off against the plan; may be repeated.",
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
"""Gives a command the options of a scene; their values are its first argument."""
