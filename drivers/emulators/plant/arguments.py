"""Command-line arguments that say which world an emulator belongs to."""

from __future__ import annotations

import argparse
from pathlib import Path

from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.tips import CylinderTip, SphereTip, Tip
from drivers.emulators.plant.truth import draw_truth, read_truth
from tacauchy_rig.run import Vector3

_TIPS = ("cylinder", "sphere")


def add_plant_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--seed``, ``--truth``, ``--surface-m``, ``--tip``, ``--diameter-m``, ``--fillet-m``."""
    add = parser.add_argument
    add("--seed", type=int, default=0, help="draws the emulated world")
    add("--truth", type=Path, help="truth.json to use instead of the seed")
    add("--surface-m", type=_point, default=(0.0, 0.0, 0.0), help="x,y,z of the expected surface")
    add("--tip", choices=_TIPS, default="cylinder")
    add("--diameter-m", type=float, default=5e-3)
    add("--fillet-m", type=float, default=1e-4)


def plant_from_arguments(arguments: argparse.Namespace) -> Plant:
    """Build the plant that the arguments describe.

    Raises:
        RecordError: The truth file cannot be read.
        ConfigError: The tip is impossible.
    """
    given: Path | None = arguments.truth
    truth = draw_truth(arguments.seed) if given is None else read_truth(given)
    tip: Tip = SphereTip(diameter_m=arguments.diameter_m)
    if arguments.tip == "cylinder":
        tip = CylinderTip(diameter_m=arguments.diameter_m, fillet_m=arguments.fillet_m)
    return Plant(truth, tip, arguments.surface_m)


def _point(text: str) -> Vector3:
    x, y, z = (float(part) for part in text.split(","))
    return (x, y, z)
