"""What is believed about the error of F_z on a mesh, from presses that were measured.

``sim.studies.accuracy.force_error_table`` presses scenes with every setting and on finer meshes,
lays a fit through what it finds (``sim.error.fit``) and writes both to a file that ships with the
program. A scene outside what was measured gets no number here: ``sim.force_error_estimate`` presses
it again on coarser meshes.
"""

from __future__ import annotations

import statistics
from dataclasses import replace
from functools import cache

from sim.effects.mesh_choice import MeshKind, mesh_choice, mesh_depth
from sim.effects.presets import sectors_of
from sim.error.fit import QUANTILE, Circumstances, ForceErrorFit, fits
from sim.error.measured_rows import ForceErrorRow, indenter_kind, rows
from sim.error.section_error import section_error
from sim.error.settings import FAST, Setting, setting_of
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Preset, Scene

_DEPTH_SHARE_MAX = 0.25
# A fit is believed this far beyond what it was laid through.
_BEYOND = 1.1


def force_error(scene: Scene, *, depth_m: float | None = None) -> tuple[float | None, str]:
    """Return the believed relative error of a scene's F_z, or None, and how it is known.

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
    error = fit.believed(section_error(scene, depth_m=depth), sectors_of(scene), limited)
    return error, (
        f"{kind}: the mesh's section tried at small strains; {QUANTILE:.0%} of {fit.press_count} "
        "measured presses, each left out in its turn, err by no more than a fit through the others "
        "makes of that"
    )


def why_unknown(scene: Scene, *, depth_m: float) -> str:
    """Say why nothing is believed about a scene's F_z at a depth [m], or nothing."""
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


def measured_kinds() -> tuple[str, ...]:
    """Return the kinds of indenter that were measured."""
    return tuple(fits())


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
    if scene.material.law is LawName.PAPER_EQ4:
        return "the paper's printed Eq. 4 was not measured"
    if not scene.motion.is_straight:
        return "only straight presses were measured"
    choice = mesh_choice(scene)
    if choice.kind is MeshKind.FOOTPRINT:
        return f"no footprint mesh was measured, and {choice.reason}"
    return ""
