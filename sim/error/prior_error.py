"""The prior error of F_z on a mesh: what presses that were measured let one expect of it.

``sim.studies.accuracy.force_error_table`` presses scenes with every setting and on finer meshes,
lays a fit through what it finds and writes both to a file that ships with the program. A scene
outside what was measured gets no number here: ``sim.force_error_estimate`` presses it again on
coarser meshes.

What the edges in a mesh's section through its axis do to F_z at small strains, e_s
(``sim.error.section_error``), they do to the real press nearly alike. On top comes what a section
does not have: its sectors are plane, n of them in a turn, and the limit that an error is held
against may itself be a little off. How much, is a matter of the press: it grows towards nu = 1/2
and with the indenter's width over the pad's height. So, for a kind of indenter,

    |error| = A |e_s| + (C + (16 / n)^4) exp(B + b1 ln(1 / (1 - 2 nu)) + b2 ln(R / H)
              + b3 ln(fillet / R)),

and errors scatter about it by a tenth of it and 0.15 %, times a margin that comes out.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from sim.arrays import FloatArray
from sim.effects.mesh_choice import MeshKind, mesh_choice, mesh_depth
from sim.effects.presets import sectors_of
from sim.error.measured_errors import (
    FAST,
    ForceErrorRow,
    Setting,
    indenter_kind,
    rows,
    setting_of,
    stored,
)
from sim.error.section_error import section_error
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Preset, Scene

# So many presses that a fit has not seen err by no more than it says: what a tolerance promises is
# to be kept nine times of ten.
QUANTILE = 0.9
_SCATTER_SHARE, _SCATTER_LEAST = 0.1, 1.5e-3
_SECTORS, _SECTOR_ORDER = 16.0, 4.0
# Of the pad's height: the deepest that was measured.
_DEPTH_SHARE_MAX = 0.25
# A fit holds this far beyond what it was laid through.
_BEYOND = 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Circumstances:
    """What of a press its error is in proportion to, besides its mesh; shares as in the rows."""

    poisson: float
    radius_share: float
    fillet_share: float

    @property
    def logarithms(self) -> tuple[float, ...]:
        """What the exponents are of."""
        rim = (math.log(self.fillet_share),) if self.fillet_share > 0.0 else ()
        return (-math.log(1.0 - 2.0 * self.poisson), math.log(self.radius_share), *rim)


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceErrorFit:
    """The fit of one kind of indenter.

    Attributes:
        coefficients: ln A, ln C, B, b1, b2 and, under a punch, b3.
        margin: 90 % of the errors of presses that were left out of the fit, each in its turn, lie
            at most so many scatters above it.
        lowest: The least of every circumstance that was measured.
        highest: The largest of them.
        depth_share_least: The least depth over the depth that its mesh was made for.
        press_count: Presses that it rests on.
    """

    coefficients: tuple[float, ...]
    margin: float
    lowest: Circumstances
    highest: Circumstances
    depth_share_least: float
    press_count: int

    def middle(self, section_error: float, sector_count: int, press: Circumstances) -> float:
        """Return the relative error that is as likely too small as too large."""
        return modelled_errors(
            np.array(self.coefficients),
            abs(section_error),
            sector_count,
            np.array(press.logarithms),
        ).item()

    def bound(self, section_error: float, sector_count: int, press: Circumstances) -> float:
        """Return the relative error that 90 % of presses stay within."""
        middle = self.middle(section_error, sector_count, press)
        return middle + self.margin * float(scatter(np.array(middle)))


@cache
def fits() -> dict[str, ForceErrorFit]:
    """Return the fit of every kind that was measured."""
    return {kind: _read(fit) for kind, fit in stored()["fits"].items()}


def modelled_errors(
    coefficients: FloatArray,
    sections: FloatArray | float,
    sectors: FloatArray | float,
    logarithms: FloatArray,
) -> FloatArray:
    """Return what a fit gives for one row or many.

    Args:
        coefficients: As in ``ForceErrorFit``.
        sections: Absolute error of each row's section at small strains.
        sectors: Of a full turn.
        logarithms: What the exponents are of, a line for each row where there are many.
    """
    slope, common, level = coefficients[:3]
    rest = np.exp(common) + (_SECTORS / sectors) ** _SECTOR_ORDER
    power = level + logarithms @ coefficients[3:]
    return np.asarray(np.exp(slope) * sections + rest * np.exp(power))


def scatter(errors: FloatArray) -> FloatArray:
    """Return how far errors usually lie from what a fit gives."""
    return _SCATTER_SHARE * errors + _SCATTER_LEAST


def _read(fit: dict[str, Any]) -> ForceErrorFit:
    bounds = {name: Circumstances(**fit[name]) for name in ("lowest", "highest")}
    return ForceErrorFit(**{**fit, **bounds, "coefficients": tuple(fit["coefficients"])})


def force_error(scene: Scene, *, depth_m: float | None = None) -> tuple[float | None, str]:
    """Return the prior relative error of a scene's F_z, or None, and how it is known.

    Args:
        depth_m: Where the press is judged [m]; None is where its mesh was made for. A mesh made for
            a deeper press is coarse for a shallow one.
    """
    depth = mesh_depth(scene) if depth_m is None else depth_m
    kind, setting, indenter = indenter_kind(scene.indenter), setting_of(scene), scene.indenter
    fit, unknown = fits().get(kind), why_unknown(scene, depth_m=depth)
    if unknown or fit is None or not isinstance(indenter, Cylinder | Sphere):
        return None, unknown
    if setting.preset is Preset.PAPER:
        return _worst(kind, setting)
    limited = _limited(fit, circumstances_of(scene, indenter))
    error = fit.bound(section_error(scene, depth_m=depth), sectors_of(scene), limited)
    return error, (
        f"{kind}: the mesh's section tried at small strains; {QUANTILE:.0%} of {fit.press_count} "
        "measured presses, each left out in its turn, err by no more than a fit through the others "
        "makes of that"
    )


def why_unknown(scene: Scene, *, depth_m: float) -> str:
    """Say why no prior error of a scene's F_z is known at a depth [m], or nothing."""
    kind, setting, indenter = indenter_kind(scene.indenter), setting_of(scene), scene.indenter
    fit, outside = fits().get(kind), _outside(scene, depth_m)
    if outside:
        return outside
    if fit is None or not isinstance(indenter, Cylinder | Sphere):
        return f"no {kind} was measured"
    if not is_measured(setting):
        return f"no {kind} was measured on preset {setting}"
    if setting.preset is Preset.PAPER:
        return ""
    return _beyond(fit, circumstances_of(scene, indenter), depth_m / mesh_depth(scene))


def is_measured(setting: Setting) -> bool:
    """Return whether any press was measured with a setting."""
    return setting in _spent(None)


def time_ratio(setting: Setting, to: Setting, *, kind: str | None = None) -> float:
    """Return how many times as long a press takes with one setting as with another.

    Each one's is the median over its presses of processor time over preset fast's, so that a busy
    machine changes it little.

    Args:
        kind: Of the indenter; one that was not measured gets the median over all.
    """
    return _over_fast(setting, kind) / _over_fast(to, kind)


@cache
def _over_fast(setting: Setting, kind: str | None) -> float:
    own, fast = (_spent(kind)[each] for each in (setting, FAST))
    return statistics.median(seconds / fast[press] for press, seconds in own.items())


@cache
def _spent(kind: str | None) -> dict[Setting, dict[int, float]]:
    """Return the processor time of every setting's presses [s]."""
    known = [row for row in rows() if row.kind == kind] or rows()
    found: dict[Setting, dict[int, float]] = {}
    for row in known:
        found.setdefault(row.setting, {})[row.press] = row.cpu_s
    return found


def typical_error(setting: Setting) -> float:
    """Return the median error of a setting over all presses that were measured with it."""
    return statistics.median(row.error for row in rows() if row.setting == setting)


def circumstances_of(scene: Scene, indenter: Cylinder | Sphere) -> Circumstances:
    """Return what of a round indenter's press its error is in proportion to."""
    fillet = indenter.fillet_m if isinstance(indenter, Cylinder) else 0.0
    return Circumstances(
        poisson=scene.material.poisson,
        radius_share=indenter.radius_m / scene.pad.height_m,
        fillet_share=fillet / indenter.radius_m,
    )


def _worst(kind: str, setting: Setting) -> tuple[float | None, str]:
    """Return the largest error of a setting whose mesh is the same for every press."""
    near = [row for row in rows() if row.kind == kind and row.setting == setting]
    worst: ForceErrorRow = max(near, key=lambda row: row.error)
    return worst.error, (
        f"{kind}: largest of {len(near)} differences from the limit of finer meshes: "
        f"{worst.indenter}, nu {worst.poisson:g}, at {worst.pad_share:.0%} of the pad"
    )


def _limited(fit: ForceErrorFit, found: Circumstances) -> Circumstances:
    """Return circumstances no milder than the mildest that were measured."""
    return replace(
        found,
        poisson=max(found.poisson, fit.lowest.poisson),
        fillet_share=min(found.fillet_share, fit.highest.fillet_share),
    )


def _beyond(fit: ForceErrorFit, found: Circumstances, depth_share: float) -> str:
    """Say where a press lies beyond what a fit was laid through, or nothing.

    Args:
        depth_share: Depth over the depth that the mesh was made for, which decides under a ball.
    """
    low, high = fit.lowest.radius_share / _BEYOND, _BEYOND * fit.highest.radius_share
    if not low <= found.radius_share <= high:
        return (
            f"the indenter's radius is {found.radius_share:.2g} times the pad's height, and "
            f"{low:.2g} to {high:.2g} were measured"
        )
    if found.fillet_share == 0.0 and depth_share < fit.depth_share_least / _BEYOND:
        return f"the press ends at {depth_share:.0%} of the depth that its mesh is made for"
    return ""


def _outside(scene: Scene, depth_m: float) -> str:
    """Say what of a scene lies outside the presses that were measured, or nothing."""
    if scene.layers:
        return "no gel of several layers was measured"
    highest = max(row.poisson for row in rows())
    if scene.material.poisson > highest:
        return f"Poisson's ratio {scene.material.poisson:g} is above {highest:g}"
    if depth_m > _DEPTH_SHARE_MAX * scene.pad.height_m:
        return f"the press is deeper than {_DEPTH_SHARE_MAX:.0%} of the pad"
    if scene.contact is not ContactMode.FRICTIONLESS:
        return "no bonded contact and none with friction was measured"
    if scene.material.law == LawName.PAPER_EQ4:
        return "the paper's printed Eq. 4 was not measured"
    if scene.material.law not in set(LawName):
        return f"the law {scene.material.law} was not measured"
    if not scene.motion.is_straight:
        return "only straight presses were measured"
    choice = mesh_choice(scene)
    if choice.kind is MeshKind.FOOTPRINT:
        return f"no footprint mesh was measured, and {choice.reason}"
    return ""
