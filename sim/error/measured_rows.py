"""The presses on which what is believed about the error of F_z rests, as the program ships them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from sim.error.settings import Setting
from sim.scene.indenter import Cylinder, Indenter, describe
from sim.scene.scene import Preset

FILE = "force_errors.json"
BALL, ROUNDED, SHARP = "sphere", "cylinder with a rounded rim", "cylinder with a sharp rim"
_ROUNDED_SHARE = 0.0199


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
