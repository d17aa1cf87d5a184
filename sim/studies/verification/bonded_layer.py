"""A flat punch and a ball on a bonded layer, against Hertz and the exact layer at small strains."""

from __future__ import annotations

from sim.press import press
from sim.press_command import press_command
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import LawName, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.layered_solution import BondedLayers, Ply, hertz_force
from sim.studies.verification.prose import stated
from tacauchy_rig.tables import Cell, Table, table_of_rows

_YOUNG_PA = 0.3e6
_PUNCH = Cylinder(diameter_m=5e-3)
_PUNCH_PAD = DiscPad(radius_m=22.5e-3, height_m=4.5e-3)
_PUNCH_DEPTH_M = 0.05e-3
# Poisson's ratio, and by how much the force may be off.
PUNCH_ALLOWED = ((0.45, 0.015), (0.47, 0.015), (0.49, 0.015), (0.499, 0.03))

_BALL = Sphere(diameter_m=2e-3)
_BALL_POISSON = 0.48
_BALL_ALLOWED = 0.015
# Below this contact radius over thickness the layer is a half space, and Hertz is to be met.
_THICK_SHARE = 0.01
# Thickness and depth [m].
BALL_PRESSES = ((15e-3, 10e-6), (15e-3, 20e-6), (4e-3, 40e-6), (2e-3, 40e-6))


def measure_punch(
    *, preset: Preset = Preset.ACCURATE, allowed: tuple[tuple[float, float], ...] = PUNCH_ALLOWED
) -> Table:
    """Press a flat punch at every Poisson's ratio."""
    rows: list[dict[str, Cell]] = []
    passed = True
    scenes = [_scene(_PUNCH, _PUNCH_PAD, poisson, _PUNCH_DEPTH_M, preset) for poisson, _ in allowed]
    for scene, (poisson, limit) in zip(scenes, allowed, strict=True):
        layer = BondedLayers([Ply(_YOUNG_PA, poisson, _PUNCH_PAD.height_m)])
        expected = layer.punch_force(radius_m=_PUNCH.radius_m, depth_m=_PUNCH_DEPTH_M)
        force = press(scene).force_n[2]
        error = force / expected - 1.0
        passed &= abs(error) <= limit
        rows.append(
            {
                "nu": poisson,
                "kappa": layer.punch_factor(_PUNCH.radius_m),
                "F_z [N]": force,
                "exact [N]": expected,
                "error [%]": 100.0 * error,
                "allowed [%]": 100.0 * limit,
            }
        )
    return table_of_rows(
        rows,
        passed=passed,
        command=press_command(scenes[0]),
        **stated("punch", preset=preset),
    )


def measure_ball(
    *, preset: Preset = Preset.ACCURATE, presses: tuple[tuple[float, float], ...] = BALL_PRESSES
) -> Table:
    """Press a ball into pads of different thickness."""
    rows: list[dict[str, Cell]] = []
    passed = True
    terms = {"radius_m": 0.5 * _BALL.diameter_m, "young_pa": _YOUNG_PA, "poisson": _BALL_POISSON}
    for height, depth in presses:
        force = press(_ball_scene(height, depth, preset)).force_n[2]
        hertz = hertz_force(depth_m=depth, **terms)
        layers = BondedLayers([Ply(_YOUNG_PA, _BALL_POISSON, height)])
        layer, contact = layers.ball_force(radius_m=terms["radius_m"], depth_m=depth)
        expected = hertz if contact < _THICK_SHARE * height else layer
        passed &= abs(force / expected - 1.0) <= _BALL_ALLOWED
        rows.append(
            {
                "pad [mm]": height * 1e3,
                "depth [mm]": depth * 1e3,
                "a / h": contact / height,
                "F_z [N]": force,
                "Hertz [N]": hertz,
                "off Hertz [%]": 100.0 * (force / hertz - 1.0),
                "layer [N]": layer,
                "off the layer [%]": 100.0 * (force / layer - 1.0),
            }
        )
    return table_of_rows(
        rows,
        passed=passed,
        command=press_command(_ball_scene(*presses[0], preset)),
        **stated("ball", preset=preset),
    )


def _ball_scene(height_m: float, depth_m: float, preset: Preset) -> Scene:
    pad = DiscPad(radius_m=15e-3, height_m=height_m)
    return _scene(_BALL, pad, _BALL_POISSON, depth_m, preset)


def _scene(
    indenter: Indenter, pad: DiscPad, poisson: float, depth_m: float, preset: Preset
) -> Scene:
    return Scene(
        pad=pad,
        material=Material(young_pa=_YOUNG_PA, poisson=poisson, law=LawName.LINEAR),
        indenter=indenter,
        target=Target(depth_m=depth_m),
        preset=preset,
    )
