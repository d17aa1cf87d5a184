"""Scenes: those that a tolerance's belief is measured on, and held-out ones that it is judged on.

``HELD_OUT`` decides. ``SEEN_BEFORE`` had that part earlier and were looked at while the method was
made: none of their numbers is in the table, but they are no longer unseen. Both ten have the same
tolerances. ``scenes.toml`` states them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from enum import IntEnum
from importlib import resources

from sim.error.measured_errors import SETTINGS, Setting
from sim.error.tolerance import Tolerance, parse_tolerance
from sim.press_command import scene_from
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor

DEPTH_SHARES = (0.4, 0.7, 1.0)
# No effect is left out.
_TRAINING_TOLERANCE = 2e-4
_ANY_FORCE_N = 1.0
_GEL_PAD = load_sensor("gelsight-mini").pad


class Effort(IntEnum):
    """Up to which settings a press is made; what all presses share tells how much others err."""

    USUAL = 0
    LONG = 1
    LONGEST = 2


_LONG = {Setting(Preset.FAST, 2.5), Setting(Preset.FAST, 2.85)}
_LONGEST = {Setting(Preset.FAST, 3.3), Setting(Preset.REFERENCE)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """A press of the table.

    Attributes:
        depths_m: Where it is judged, in ascending order [m].
    """

    scene: Scene
    depths_m: tuple[float, ...]
    effort: Effort

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What it is pressed with, the cheapest first."""
        barred = _LONGEST if self.effort < Effort.LONGEST else set()
        barred = barred | _LONG if self.effort < Effort.LONG else barred
        # The paper's mesh is that of the paper's gel.
        barred = barred if self.scene.pad == _GEL_PAD else barred | {Setting(Preset.PAPER)}
        return tuple(setting for setting in SETTINGS if setting not in barred)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A scene that had no part in the table, and how well its F_z must be known."""

    scene: Scene
    tolerance: Tolerance

    @property
    def name(self) -> str:
        """Indenter, pad unless it is a sensor's, Poisson's ratio and target, for a table."""
        body, pad, target = self.scene.indenter, self.scene.pad, self.scene.target
        words = [f"{body.diameter_m * 1e3:g} mm ball"] if isinstance(body, Sphere) else []
        if isinstance(body, Cylinder):
            words += [f"{body.diameter_m * 1e3:g} mm punch", f"{body.fillet_m * 1e3:g} mm fillet"]
        if isinstance(pad, BoxPad | DiscPad) and not self.scene.sensor:
            kind = "box" if isinstance(pad, BoxPad) else "disc"
            words.append(f"{kind} {pad.height_m * 1e3:g} mm")
        words.append(f"nu {self.scene.material.poisson:g}")
        if target.depth_m is not None:
            words.append(f"{target.depth_m * 1e3:g} mm deep")
        else:
            words.append(f"to {target.force_n:g} N")
        return ", ".join(words)


def _training(press: str, *, effort: str = "usual", to_force: bool = False) -> Training:
    """Return a press of the table.

    Args:
        press: Its words, with the greatest depth.
        effort: Name of its ``Effort``.
        to_force: On the mesh that a press to a force gets, which is made before its depth is known.
    """
    scene = replace(scene_from(press), tolerance=_TRAINING_TOLERANCE, sensor="")
    depths = tuple(share * (scene.target.depth_m or 0.0) for share in DEPTH_SHARES)
    if to_force:
        scene = replace(scene, target=Target(force_n=_ANY_FORCE_N))
    return Training(scene=scene, depths_m=depths, effort=Effort[effort.upper()])


def _held_out(press: str, tolerance: str) -> HeldOut:
    return HeldOut(scene_from(press), parse_tolerance(tolerance, field="tolerance"))


_FILE = resources.files("sim.studies.accuracy").joinpath("scenes.toml")
_STATED = tomllib.loads(_FILE.read_text("utf-8"))

TRAINING = tuple(_training(**each) for each in _STATED["training"])
SEEN_BEFORE, HELD_OUT = (
    tuple(_held_out(**each) for each in _STATED[name]) for name in ("seen_before", "held_out")
)
