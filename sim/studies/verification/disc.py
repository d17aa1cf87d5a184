"""A bonded punch on a clamped disc at finite strain, against axisymmetric solutions."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from importlib import resources

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.press_command import scene_from
from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.studies.verification.prose import stated
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

_ALLOWED = 0.01
_FILE = "disc_press_nu045.csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscForce:
    """One force of the reference, with how far its finest mesh is from it."""

    law: LawName
    depth_m: float
    force_n: float
    uncertainty_n: float


def measure(*, preset: Preset = Preset.ACCURATE, depth_max_m: float = 0.5e-3) -> Table:
    """Press both laws through the reference's depths, each along one path."""
    rows: list[dict[str, Cell]] = []
    worst, words = 0.0, ""
    for law in (LawName.NEO_HOOKEAN, LawName.STABLE_NEO_HOOKEAN):
        wanted = [f for f in disc_forces() if f.law is law and f.depth_m <= depth_max_m]
        words = disc_press(law, wanted[-1].depth_m, preset)
        scene = scene_from(words)
        path = path_for(scene, plan_effects(scene))
        for reference in wanted:
            force = float(path.advance(reference.depth_m).force_n[2])
            error = force / reference.force_n - 1.0
            doubt = reference.uncertainty_n / reference.force_n
            worst = max(worst, abs(error))
            rows.append(
                {
                    "law": law.value,
                    "depth [mm]": round(reference.depth_m * 1e3, 6),
                    "F_z [N]": force,
                    "reference [N]": reference.force_n,
                    "error [%]": 100 * error,
                    "reference's own doubt [%]": 100 * doubt,
                }
            )
    return table_of_rows(
        rows,
        passed=worst <= _ALLOWED,
        command=f"tacauchy-rig press {words}",
        **stated("disc", preset=preset),
    )


def disc_forces() -> tuple[DiscForce, ...]:
    """Return the reference's forces, rising in depth for each law."""
    text = resources.files("sim.studies.verification.data").joinpath(_FILE).read_text("utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    return tuple(
        DiscForce(
            law=LawName(row["law"]),
            depth_m=float(row["depth_mm"]) * 1e-3,
            force_n=float(row["force_n"]),
            uncertainty_n=float(row["uncertainty_n"]),
        )
        for row in csv.DictReader(lines)
    )


def disc_press(law: LawName, depth_m: float, preset: Preset) -> str:
    """Return the reference's press as the command line takes it."""
    return (
        "--pad disc:radius=12mm,height=4.5mm --indenter cylinder:diameter=5mm "
        f"--depth {depth_m * 1e3:g}mm --young 0.3MPa --poisson 0.45 --law {law.value} "
        f"--contact bonded --preset {preset.value}"
    )
