"""A flat punch and a ball on a bonded layer, against Hertz and the exact layer at small strains."""

from __future__ import annotations

from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import Preset
from sim.studies.verification.layered_solution import BondedLayers, Ply, hertz_force
from sim.studies.verification.prose import stated
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

_YOUNG_PA = 0.3e6
_PUNCH_RADIUS_M, _PUNCH_PAD_M, _PUNCH_DEPTH_M = 2.5e-3, 4.5e-3, 0.05e-3
_PUNCH = "--pad disc:radius=22.5mm,height=4.5mm --indenter cylinder:diameter=5mm --depth 0.05mm"
# Poisson's ratio, and by how much the force may be off.
PUNCH_ALLOWED = ((0.45, 0.015), (0.47, 0.015), (0.49, 0.015), (0.499, 0.03))

_BALL_RADIUS_M, _BALL_POISSON = 1e-3, 0.48
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
    presses = [_words(_PUNCH, poisson, preset) for poisson, _ in allowed]
    for words, (poisson, limit) in zip(presses, allowed, strict=True):
        layer = BondedLayers([Ply(_YOUNG_PA, poisson, _PUNCH_PAD_M)])
        expected = layer.punch_force(radius_m=_PUNCH_RADIUS_M, depth_m=_PUNCH_DEPTH_M)
        force = press(scene_from(words)).force_n[2]
        error = force / expected - 1.0
        passed &= abs(error) <= limit
        rows.append(
            {
                "nu": poisson,
                "kappa": layer.punch_factor(_PUNCH_RADIUS_M),
                "F_z [N]": force,
                "exact [N]": expected,
                "error [%]": 100.0 * error,
                "allowed [%]": 100.0 * limit,
            }
        )
    return table_of_rows(
        rows,
        passed=passed,
        command=f"tacauchy-rig press {presses[0]}",
        **stated("punch", preset=preset),
    )


def measure_ball(
    *, preset: Preset = Preset.ACCURATE, presses: tuple[tuple[float, float], ...] = BALL_PRESSES
) -> Table:
    """Press a ball into pads of different thickness."""
    rows: list[dict[str, Cell]] = []
    passed = True
    terms = {"radius_m": _BALL_RADIUS_M, "young_pa": _YOUNG_PA, "poisson": _BALL_POISSON}
    for height, depth in presses:
        force = press(scene_from(_ball(height, depth, preset))).force_n[2]
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
        command=f"tacauchy-rig press {_ball(*presses[0], preset)}",
        **stated("ball", preset=preset),
    )


def _ball(height_m: float, depth_m: float, preset: Preset) -> str:
    pad = f"--pad disc:radius=15mm,height={height_m * 1e3:g}mm"
    stated = f"{pad} --indenter sphere:diameter=2mm --depth {depth_m * 1e3:g}mm"
    return _words(stated, _BALL_POISSON, preset)


def _words(stated: str, poisson: float, preset: Preset) -> str:
    """Return a press as the command line takes it."""
    gel = f"--young {_YOUNG_PA * 1e-6:g}MPa --poisson {poisson:g} --law linear"
    return f"{stated} {gel} --preset {preset.value}"
