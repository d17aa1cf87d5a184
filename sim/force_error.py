"""What is believed about the error of F_z on a mesh, from presses that were measured.

``sim.accuracy.preset_errors`` presses a few scenes with every setting and on finer meshes, and
writes what it finds to a file that ships with the program; ``sim.force_error_fit`` lays a fit
through it, and ``force_error`` reads that. A scene outside what was measured gets no number here:
``sim.richardson`` presses it again on coarser meshes.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

from sim.effects import plan_effects
from sim.force_error_fit import QUANTILE, Circumstances, ForceErrorFit, fits
from sim.force_error_rows import ForceErrorRow, indenter_kind, rows
from sim.indenter import Cylinder, Sphere
from sim.laws.catalogue import LawName
from sim.mesh import TetMesh
from sim.mesh_choice import MeshKind, mesh_choice, mesh_depth
from sim.presets import mesh_for
from sim.scene import ContactMode, Effect, Preset, Scene
from sim.settings import Setting, setting_of

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
    fit, outside = fits().get(kind), _outside(scene, depth)
    if outside:
        return None, outside
    if fit is None or not isinstance(indenter, Cylinder | Sphere):
        return None, f"no {kind} was measured"
    if not is_measured(setting):
        return None, f"no {kind} was measured on preset {setting}"
    if setting.preset is Preset.PAPER:
        return _worst(kind, setting)
    found = circumstances_of(scene, indenter)
    outside = _beyond(fit, found, depth / mesh_depth(scene))
    if outside:
        return None, outside
    tried = {Setting(preset, fine): error for preset, fine, error in scene.tried_errors}
    if setting in tried:
        return tried[setting], (
            f"{kind}: this mesh tried at small strains; {QUANTILE:.0%} of {fit.press_count} "
            "measured presses stay within what that said of them"
        )
    error = fit.believed(setting, whole_tet_count(_mesh(scene)), _limited(fit, found))
    return error, (
        f"{kind}: fit through {fit.press_count} presses against the limit of finer meshes, "
        f"{fit.safety:.2g} times its middle so that {QUANTILE:.0%} of presses left out lie below"
    )


def middle_error(scene: Scene) -> float | None:
    """Return the error that is as likely too small as too large, or None where none is known."""
    fit, indenter = fits().get(indenter_kind(scene.indenter)), scene.indenter
    if fit is None or not isinstance(indenter, Cylinder | Sphere):
        return None
    limited = _limited(fit, circumstances_of(scene, indenter))
    return fit.middle(setting_of(scene), whole_tet_count(_mesh(scene)), limited)


def is_measured(setting: Setting) -> bool:
    """Return whether any press was measured with a setting."""
    return any(row.setting == setting for row in rows())


def time_ratio(setting: Setting, to: Setting, *, kind: str | None = None) -> float:
    """Return how many times as long a press takes with one setting as with another.

    It is the median over the presses that were measured on both, of processor time, so that a
    busy machine changes it little.

    Args:
        kind: Of the indenter; one that was not measured gets the median over all.
    """
    known = [row for row in rows() if row.kind == kind] or rows()
    spent = {(row.press, row.setting): row.cpu_s for row in known}
    ratios = [
        seconds / spent[press, to]
        for (press, own), seconds in spent.items()
        if own == setting and (press, to) in spent
    ]
    return statistics.median(ratios)


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


def whole_tet_count(mesh: TetMesh) -> int:
    """Return how many tetrahedra a mesh would have without its symmetry."""
    return len(mesh.tets) * mesh.fold.copies


def _mesh(scene: Scene) -> TetMesh:
    return mesh_for(scene, folded=plan_effects(scene).is_on(Effect.SYMMETRY))


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
