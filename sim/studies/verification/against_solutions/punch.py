"""A flat punch on a bonded layer, against the exact solution for small strains."""

from __future__ import annotations

from sim.press import press
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.against_solutions.layer_formula import punch_factor, punch_force
from sim.studies.verification.command import press_command
from tacauchy_rig.tables import Cell, Table

_PAD = DiscPad(radius_m=22.5e-3, height_m=4.5e-3)
_PUNCH = Cylinder(diameter_m=5e-3)
_DEPTH_M = 0.05e-3
_YOUNG_PA = 0.3e6
# Poisson's ratio, and by how much the force may be off.
ALLOWED = ((0.45, 0.015), (0.47, 0.015), (0.49, 0.015), (0.499, 0.03))


def measure(
    *, preset: Preset = Preset.ACCURATE, allowed: tuple[tuple[float, float], ...] = ALLOWED
) -> Table:
    """Press at every Poisson's ratio."""
    rows: list[tuple[Cell, ...]] = []
    passed = True
    for poisson, limit in allowed:
        result = press(_scene(poisson, preset))
        expected = punch_force(
            radius_m=_PUNCH.radius_m,
            height_m=_PAD.height_m,
            depth_m=_DEPTH_M,
            young_pa=_YOUNG_PA,
            poisson=poisson,
        )
        kappa = punch_factor(_PUNCH.radius_m / _PAD.height_m, poisson)
        force = result.force_n[2]
        error = force / expected - 1.0
        passed &= abs(error) <= limit
        rows.append((poisson, kappa, force, expected, 100.0 * error, 100.0 * limit))
    return Table(
        title="Flat punch on a bonded layer (Hayes et al. 1972)",
        columns=("nu", "kappa", "F_z [N]", "exact [N]", "error [%]", "allowed [%]"),
        rows=tuple(rows),
        criterion="F_z within 1.5 % of the exact force at nu 0.45, 0.47 and 0.49, within 3 % at "
        f"0.499; preset {preset.value}",
        passed=passed,
        note="F = 2 a E d kappa / (1 - nu^2); punch radius a = 2.5 mm without friction, layer of "
        "4.5 mm, E = 0.3 MPa, d = 0.05 mm, law linear, as the solution's is. Its layer is endless; "
        "the disc's radius is five thicknesses. kappa is solved from the integral equation "
        "and agrees with the published values to their four digits.",
        command=press_command(_scene(allowed[0][0], preset)),
    )


def _scene(poisson: float, preset: Preset) -> Scene:
    return Scene(
        pad=_PAD,
        material=Material(young_pa=_YOUNG_PA, poisson=poisson, law=LawName.LINEAR),
        indenter=_PUNCH,
        target=Target(depth_m=_DEPTH_M),
        preset=preset,
    )
