"""A ball on a thick pad against Hertz, and on thinner ones against the exact bonded layer."""

from __future__ import annotations

from sim.press import press
from sim.scene.indenter import Sphere
from sim.scene.material import LawName, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.against_solutions.layer_formula import ball_force, hertz_force
from sim.studies.verification.command import press_command
from tacauchy_rig.tables import Cell, Table

_ALLOWED = 0.015
_THICK_SHARE = 0.01
_RADIUS_M = 1e-3
_YOUNG_PA = 0.3e6
_POISSON = 0.48
# Thickness and travel [m].
PRESSES = ((15e-3, 10e-6), (15e-3, 20e-6), (4e-3, 40e-6), (2e-3, 40e-6))


def measure(
    *, preset: Preset = Preset.ACCURATE, presses: tuple[tuple[float, float], ...] = PRESSES
) -> Table:
    """Press the ball into every pad."""
    rows: list[tuple[Cell, ...]] = []
    passed = True
    for height, depth in presses:
        result = press(_scene(height, depth, preset))
        force = result.force_n[2]
        terms = {"radius_m": _RADIUS_M, "depth_m": depth}
        hertz = hertz_force(**terms, young_pa=_YOUNG_PA, poisson=_POISSON)
        layer, contact = ball_force(**terms, height_m=height, young_pa=_YOUNG_PA, poisson=_POISSON)
        thick = contact < _THICK_SHARE * height
        expected = hertz if thick else layer
        passed &= abs(force / expected - 1.0) <= _ALLOWED
        rows.append(
            (
                height * 1e3,
                depth * 1e3,
                contact / height,
                force,
                hertz,
                100.0 * (force / hertz - 1.0),
                layer,
                100.0 * (force / layer - 1.0),
            )
        )
    return Table(
        title="Ball on a bonded layer (Hertz; exact layer)",
        columns=(
            "pad [mm]",
            "depth [mm]",
            "a / h",
            "F_z [N]",
            "Hertz [N]",
            "off Hertz [%]",
            "layer [N]",
            "off the layer [%]",
        ),
        rows=tuple(rows),
        criterion="F_z within 1.5 % of Hertz where the contact radius a is below 1 % of the "
        f"thickness h, else of the exact layer's force; preset {preset.value}",
        passed=passed,
        note="Ball of radius 1 mm without friction, E = 0.3 MPa, nu = 0.48, law linear, discs of "
        "radius 15 mm. The layer's force is that of a paraboloid on an endless bonded layer, from "
        "the same integral equation as the punch's; on the thick pads it says how much of the "
        "difference from Hertz is the pad's and not the program's.",
        command=press_command(_scene(*presses[0], preset)),
    )


def _scene(height_m: float, depth_m: float, preset: Preset) -> Scene:
    return Scene(
        pad=DiscPad(radius_m=15e-3, height_m=height_m),
        material=Material(young_pa=_YOUNG_PA, poisson=_POISSON, law=LawName.LINEAR),
        indenter=Sphere(diameter_m=2.0 * _RADIUS_M),
        target=Target(depth_m=depth_m),
        preset=preset,
    )
