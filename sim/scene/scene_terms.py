"""The words that state a scene, as the command line and a text have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sim.scene.material import LawName
from sim.scene.scene import Drive, Output, Preset


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneTerms:
    """The words of a press: each field is the value of the option of its name.

    Attributes:
        output: What is asked for besides force and depth; no option of every command.
    """

    indenter: str
    sensor: str | None = None
    pad: str | None = None
    depth: str | None = None
    force: str | None = None
    at: str | None = None
    shift: str | None = None
    twist: str | None = None
    tilt: str | None = None
    young: str | None = None
    poisson: float | None = None
    layer: list[str] | None = None
    law: str = LawName.STABLE_NEO_HOOKEAN
    contact: str = "frictionless"
    duration: str | None = None
    preset: Preset | None = None
    mesh: str | None = None
    tolerance: str | None = None
    effect: list[str] | None = None
    drive: Drive = Drive.LOAD
    output: Sequence[Output] = ()
