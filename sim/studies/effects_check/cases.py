"""Scenes that differ in what they call for, to hold plans against everything switched on."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources

from sim.press_command import scene_from
from sim.scene.material import RelaxationTerm
from sim.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class EffectCase:
    """A scene and what sets it apart.

    Attributes:
        whole: Hold it against the whole pad, to show what symmetry is worth.
    """

    name: str
    shows: str
    scene: Scene
    whole: bool = False


def _case(
    name: str,
    shows: str,
    press: str,
    *,
    whole: bool = False,
    relaxation: Sequence[dict[str, float]] = (),
    density_kg_m3: float = 1000.0,
) -> EffectCase:
    """Return a case of ``cases.toml``; relaxation and density are no words of a press."""
    scene = scene_from(press)
    terms = tuple(RelaxationTerm(**term) for term in relaxation)
    material = replace(scene.material, relaxation=terms, density_kg_m3=density_kg_m3)
    return EffectCase(name, shows, replace(scene, material=material), whole)


_FILE = resources.files("sim.studies.effects_check").joinpath("cases.toml")
EFFECT_CASES = tuple(_case(**each) for each in tomllib.loads(_FILE.read_text("utf-8"))["case"])
