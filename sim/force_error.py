"""What is believed about the error of F_z on a mesh, from presses that were measured.

``sim.accuracy.preset_errors`` presses a few scenes with every setting and on finer meshes, and
writes what it finds to a file that ships with the program; ``force_error`` reads it. A scene
outside what was measured gets no number here: ``sim.richardson`` presses it again on coarser
meshes.
"""

from __future__ import annotations

import json
import statistics
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from sim.indenter import Cylinder, Indenter, describe
from sim.laws.catalogue import LawName
from sim.mesh_choice import MeshKind, mesh_choice, mesh_depth
from sim.scene import ContactMode, Preset, Scene
from sim.settings import Setting, setting_of

FILE = "force_errors.json"
_DEPTH_SHARE_MAX = 0.25
_POISSON_MAX = 0.485
_ROUNDED_SHARE = 0.0199
_SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceErrorRow:
    """One press with one setting.

    Attributes:
        kind: Of the indenter, as ``indenter_kind`` has it.
        depth_share: Depth over the depth that the mesh was made for.
        pad_share: Depth over the pad's height.
        refinement: Every edge this many times shorter than the preset's.
        force_n: F_z that was found [N].
        limit_n: F_z that finer and finer meshes tend to [N].
        doubt: Relative error that the limit itself may have.
        cpu_s: Processor time of the whole path to the deepest of its depths, mesh included [s].
    """

    kind: str
    indenter: str
    poisson: float
    preset: Preset
    refinement: float
    depth_m: float
    depth_share: float
    pad_share: float
    force_n: float
    limit_n: float
    doubt: float
    cpu_s: float

    @property
    def setting(self) -> Setting:
        """What it was pressed with."""
        return Setting(self.preset, self.refinement)

    @property
    def error(self) -> float:
        """Relative error that the row supports, the limit's own doubt included."""
        return abs(self.force_n / self.limit_n - 1.0) + self.doubt


@dataclass(frozen=True, slots=True, kw_only=True)
class _Depth:
    """A depth over the one that the mesh was made for, and over the pad's height."""

    mesh_share: float
    pad_share: float


def force_error(scene: Scene, *, depth_m: float | None = None) -> tuple[float | None, str]:
    """Return the believed relative error of a scene's F_z, or None, and how it is known.

    Args:
        depth_m: Where the press is judged [m]; None is where its mesh was made for. A mesh made for
            a deeper press is coarse for a shallow one.
    """
    depth = mesh_depth(scene) if depth_m is None else depth_m
    kind = indenter_kind(scene.indenter)
    shares = _Depth(mesh_share=depth / mesh_depth(scene), pad_share=depth / scene.pad.height_m)
    near = _near(kind, setting_of(scene), shares)
    outside = _outside(scene, depth)
    if not near or outside:
        on = f" on preset {setting_of(scene)}" if kind in measured_kinds() else ""
        return None, outside or f"no {kind} was measured{on}"
    worst = max(near, key=lambda row: row.error)
    return worst.error, (
        f"{kind}: largest of {len(near)} differences from the limit of finer meshes, plus that "
        f"limit's own doubt; worst: {worst.indenter}, nu {worst.poisson:g}, at "
        f"{worst.depth_m * 1e3:g} mm in a GelSight Mini"
    )


def is_measured(setting: Setting) -> bool:
    """Return whether any press was measured with a setting."""
    return any(row.setting == setting for row in _rows())


def time_ratio(setting: Setting, to: Setting) -> float:
    """Return how many times as long a press takes with one setting as with another.

    It is the median over the presses that were measured on both, of processor time, so that a
    busy machine changes it little.
    """
    spent = {(r.indenter, r.poisson, r.setting): r.cpu_s for r in _rows()}
    ratios = [
        seconds / spent[indenter, poisson, to]
        for (indenter, poisson, own), seconds in spent.items()
        if own == setting and (indenter, poisson, to) in spent
    ]
    return statistics.median(ratios)


def measured_kinds() -> tuple[str, ...]:
    """Return the kinds of indenter that were measured."""
    return tuple(dict.fromkeys(row.kind for row in _rows()))


def believed(kind: str, setting: Setting, *, pad_share: float) -> float | None:
    """Return the believed relative error of a kind with a setting at its mesh's depth, or None.

    Args:
        pad_share: Depth over the pad's height.
    """
    near = _near(kind, setting, _Depth(mesh_share=1.0, pad_share=pad_share))
    return max((row.error for row in near), default=None)


def typical_error(setting: Setting) -> float:
    """Return the median error of a setting over all presses that were measured with it."""
    return statistics.median(row.error for row in _rows() if row.setting == setting)


def indenter_kind(indenter: Indenter) -> str:
    """Return the kind of indenter whose errors are alike."""
    if not isinstance(indenter, Cylinder):
        return describe(indenter).split(":")[0]
    rounded = indenter.fillet_m >= _ROUNDED_SHARE * indenter.diameter_m
    return "cylinder with a rounded rim" if rounded else "cylinder with a sharp rim"


def _near(kind: str, setting: Setting, depth: _Depth) -> list[ForceErrorRow]:
    """Return the rows of every measured press that a press lies between.

    A ball's mesh is made for a depth, so that its shares count. A cylinder's is not, and its error
    grows with the depth in the pad: the next deeper row is on the safe side.
    """
    presses: dict[tuple[str, float], list[ForceErrorRow]] = {}
    for row in _rows():
        if row.setting == setting and row.kind == kind:
            presses.setdefault((row.indenter, row.poisson), []).append(row)
    around = _around if kind == "sphere" else _deeper
    return [row for rows in presses.values() for row in around(rows, depth)]


def _around(rows: list[ForceErrorRow], depth: _Depth) -> list[ForceErrorRow]:
    shares = [row.depth_share for row in rows]
    low = max((s for s in shares if s <= depth.mesh_share + _SAME), default=min(shares))
    high = min((s for s in shares if s >= depth.mesh_share - _SAME), default=max(shares))
    return [row for row in rows if low <= row.depth_share <= high]


def _deeper(rows: list[ForceErrorRow], depth: _Depth) -> list[ForceErrorRow]:
    deeper = [row for row in rows if row.pad_share >= depth.pad_share - _SAME]
    return [min(deeper, key=lambda row: row.pad_share, default=rows[-1])]


@cache
def _rows() -> tuple[ForceErrorRow, ...]:
    text = resources.files("sim").joinpath(FILE).read_text("utf-8")
    rows: list[dict[str, Any]] = json.loads(text)
    return tuple(ForceErrorRow(**{**row, "preset": Preset(row["preset"])}) for row in rows)


def _outside(scene: Scene, depth_m: float) -> str:
    """Say what of a scene lies outside the presses that were measured, or nothing."""
    if scene.layers:
        return "no gel of several layers was measured"
    if scene.material.poisson > _POISSON_MAX:
        return f"Poisson's ratio {scene.material.poisson:g} is above {_POISSON_MAX:g}"
    if depth_m > _DEPTH_SHARE_MAX * scene.pad.height_m:
        return f"the press is deeper than {_DEPTH_SHARE_MAX:.0%} of the pad"
    if scene.contact is not ContactMode.FRICTIONLESS:
        return "no bonded contact and none with friction was measured"
    if scene.material.law is LawName.PAPER_EQ4:
        return "the paper's printed Eq. 4 was not measured"
    if not scene.motion.is_straight:
        return "only straight presses were measured"
    choice = mesh_choice(scene)
    if choice.kind is MeshKind.FOOTPRINT:
        return f"no footprint mesh was measured, and {choice.reason}"
    return ""
