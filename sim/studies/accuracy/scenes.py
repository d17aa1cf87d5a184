"""Held-out scenes that a tolerance's promise is judged on.

``HELD_OUT`` decides. ``SEEN_BEFORE`` had that part earlier and were looked at while an earlier
method was made. Both ten have the same tolerances. ``scenes.toml`` states them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources

from sim.error.tolerance import Tolerance, parse_tolerance
from sim.press_command import scene_from
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A scene that had no part in making the rule, and how well its F_z must be known."""

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


def _held_out(press: str, tolerance: str) -> HeldOut:
    return HeldOut(scene_from(press), parse_tolerance(tolerance, field="tolerance"))


_FILE = resources.files("sim.studies.accuracy").joinpath("scenes.toml")
_STATED = tomllib.loads(_FILE.read_text("utf-8"))

SEEN_BEFORE, HELD_OUT = (
    tuple(_held_out(**each) for each in _STATED[name]) for name in ("seen_before", "held_out")
)
