"""What was measured about the error of F_z, as the program ships it: presses by setting.

A setting is what a tolerance may choose: a preset, or a mesh between two of them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Any

from sim.scene.indenter import Cylinder, Indenter, describe
from sim.scene.scene import Preset, Scene

FILE = "force_errors.json"
BALL, ROUNDED, SHARP = "sphere", "cylinder with a rounded rim", "cylinder with a sharp rim"
_ROUNDED_SHARE = 0.0199


@dataclass(frozen=True, slots=True)
class Setting:
    """A preset, and how many times shorter than its own every edge is."""

    preset: Preset
    refinement: float = 1.0

    def __str__(self) -> str:
        if self.refinement == 1.0:
            return self.preset.value
        return f"{self.preset.value}, edges {1.0 / self.refinement:.3g} times as long"

    def applied(self, scene: Scene) -> Scene:
        """Return a scene with these settings."""
        return replace(scene, preset=self.preset, refinement=self.refinement)


def setting_of(scene: Scene) -> Setting:
    """Return a scene's settings."""
    return Setting(scene.preset, scene.refinement)


FAST = Setting(Preset.FAST)
# Neighbouring costs are 1.3 to 1.8 times apart.
LADDER = tuple(
    Setting(Preset.FAST, refinement)
    for refinement in (0.62, 0.75, 0.9, 1.0, 1.18, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.85, 3.3)
)
SETTINGS = (
    Setting(Preset.PAPER),
    *LADDER,
    Setting(Preset.BALANCED),
    Setting(Preset.ACCURATE),
    Setting(Preset.REFERENCE),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceErrorRow:
    """One press with one setting, at one depth.

    Attributes:
        press: Number of the press; the same for all its settings and depths.
        kind: Of the indenter, as ``indenter_kind`` has it.
        radius_share: The indenter's radius over the pad's height.
        fillet_share: Its fillet over its radius; 0 for a ball.
        depth_share: Depth over the depth that the mesh was made for.
        pad_share: Depth over the pad's height.
        refinement: Every edge this many times shorter than the preset's.
        sector_count: Sectors of a full turn.
        force_n: F_z that was found [N].
        limit_n: F_z that finer and finer meshes tend to [N].
        doubt: Relative error that the limit itself may have.
        section_error: Relative error of F_z at small strains on the mesh's section, with its sign
            (``sim.error.section_error``); None for a mesh that was not revolved.
        cpu_s: Processor time of the whole path to the deepest of its depths, mesh included [s].
    """

    press: int
    kind: str
    indenter: str
    poisson: float
    radius_share: float
    fillet_share: float
    preset: Preset
    refinement: float
    sector_count: int
    depth_m: float
    depth_share: float
    pad_share: float
    force_n: float
    limit_n: float
    doubt: float
    section_error: float | None
    cpu_s: float

    @property
    def setting(self) -> Setting:
        """What it was pressed with."""
        return Setting(self.preset, self.refinement)

    @property
    def error(self) -> float:
        """Relative error of its force, without its sign."""
        return abs(self.force_n / self.limit_n - 1.0)


@cache
def stored() -> dict[str, Any]:
    """Return what the file holds: ``rows``, and ``fits`` by kind of indenter."""
    found: dict[str, Any] = json.loads(
        resources.files("sim.error").joinpath(FILE).read_text("utf-8")
    )
    return found


@cache
def rows() -> tuple[ForceErrorRow, ...]:
    """Return every row of the file."""
    return tuple(
        ForceErrorRow(**{**row, "preset": Preset(row["preset"])}) for row in stored()["rows"]
    )


def indenter_kind(indenter: Indenter) -> str:
    """Return the kind of indenter whose errors are alike."""
    if not isinstance(indenter, Cylinder):
        return describe(indenter).split(":")[0]
    rounded = indenter.fillet_m >= _ROUNDED_SHARE * indenter.diameter_m
    return ROUNDED if rounded else SHARP
