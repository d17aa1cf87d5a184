"""What is believed about the error of F_z, and how that was measured.

``measure_force_errors`` presses a few scenes on every preset and on the finest one, and writes the
differences to a file that ships with the program; ``force_error`` reads it. A scene outside what
was measured gets no number here: ``sim.richardson`` presses it again on coarser meshes.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from pathlib import Path

from sim.indenter import Cylinder, Indenter, Sphere, describe
from sim.laws.catalogue import LawName
from sim.loading import LoadingPath
from sim.mesh_choice import MeshKind, mesh_choice
from sim.presets import build_model
from sim.scene import ContactMode, Preset, Scene, Target
from sim.sensor import Sensor

DEPTHS_M = (0.2e-3, 0.45e-3, 0.7e-3)
INDENTERS: tuple[Indenter, ...] = (
    Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
    Sphere(diameter_m=15e-3),
)
_FILE = "force_errors.json"
_DEPTH_SHARE_MAX = 0.25
_POISSON_MAX = 0.485
_ROUNDED_SHARE = 0.0199


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceErrorRow:
    """One press on one preset.

    Attributes:
        force_n: F_z of the preset [N].
        reference_n: F_z of preset reference [N].
        reference_error: Relative difference of presets accurate and reference: how far the
            reference itself may still be from the limit.
    """

    indenter: str
    preset: str
    depth_m: float
    force_n: float
    reference_n: float
    reference_error: float

    @property
    def error(self) -> float:
        """Relative error that the row supports, the reference's own doubt included."""
        return abs(self.force_n / self.reference_n - 1.0) + self.reference_error


def force_error(scene: Scene) -> tuple[float | None, str]:
    """Return the believed relative error of a scene's F_z, or None, and how it is known."""
    kind = _kind(scene.indenter)
    rows = [r for r in _rows() if r.preset == scene.preset.value and _row_kind(r) == kind]
    outside = _outside(scene)
    if not rows or outside:
        reason = outside or f"no {kind} was measured on preset {scene.preset.value}"
        return None, reason
    worst = max(rows, key=lambda row: row.error)
    return worst.error, (
        f"{kind}: largest difference of {len(rows)} presses into a GelSight Mini from preset "
        f"reference, plus the reference's own doubt; worst: {worst.indenter} at "
        f"{worst.depth_m * 1e3:g} mm"
    )


def measure_force_errors(sensor: Sensor, path: Path) -> list[ForceErrorRow]:
    """Press every indenter on every preset and write the rows to a JSON file; takes minutes."""
    rows = []
    for indenter in INDENTERS:
        forces = {preset: _forces(sensor, indenter, preset) for preset in Preset}
        for preset, depth in ((p, d) for p in Preset for d in range(len(DEPTHS_M))):
            reference = forces[Preset.REFERENCE][depth]
            rows.append(
                ForceErrorRow(
                    indenter=describe(indenter),
                    preset=preset.value,
                    depth_m=DEPTHS_M[depth],
                    force_n=forces[preset][depth],
                    reference_n=reference,
                    reference_error=abs(forces[Preset.ACCURATE][depth] / reference - 1.0),
                )
            )
    path.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", "utf-8")
    return rows


def _forces(sensor: Sensor, indenter: Indenter, preset: Preset) -> list[float]:
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        layers=sensor.layers,
        indenter=indenter,
        target=Target(depth_m=max(DEPTHS_M)),
        preset=preset,
    )
    path = LoadingPath(build_model(scene), indenter)
    return [float(path.advance(depth).force_n[2]) for depth in DEPTHS_M]


@cache
def _rows() -> tuple[ForceErrorRow, ...]:
    text = resources.files("sim").joinpath(_FILE).read_text("utf-8")
    return tuple(ForceErrorRow(**row) for row in json.loads(text))


def _kind(indenter: Indenter) -> str:
    if not isinstance(indenter, Cylinder):
        return describe(indenter).split(":")[0]
    rounded = indenter.fillet_m >= _ROUNDED_SHARE * indenter.diameter_m
    return "cylinder with a rounded rim" if rounded else "cylinder with a sharp rim"


def _row_kind(row: ForceErrorRow) -> str:
    return {describe(indenter): _kind(indenter) for indenter in INDENTERS}[row.indenter]


def _outside(scene: Scene) -> str:
    """Say what of a scene lies outside the presses that were measured, or nothing."""
    depth = scene.target.depth_m
    if scene.layers:
        return "no gel of several layers was measured"
    if scene.material.poisson > _POISSON_MAX:
        return f"Poisson's ratio {scene.material.poisson:g} is above {_POISSON_MAX:g}"
    if depth is not None and depth > _DEPTH_SHARE_MAX * scene.pad.height_m:
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
