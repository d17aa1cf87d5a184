"""The presses that a tolerance's belief is made of; what it is judged on is in promise_scenes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

from sim.error.settings import SETTINGS, Setting
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.pad import BoxPad, DiscPad, Pad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor

DEPTH_SHARES = (0.4, 0.7, 1.0)
# No effect is left out.
_TOLERANCE = 2e-4
_ANY_FORCE_N = 1.0
_GEL = load_sensor("gelsight-mini")
_DISC = DiscPad(radius_m=11e-3, height_m=4.6e-3)
_BOX = BoxPad(size_x_m=22e-3, size_y_m=19e-3, height_m=3.1e-3)


class Effort(IntEnum):
    """Up to which settings a press is made; what all presses share tells how much others err."""

    USUAL = 0
    LONG = 1
    LONGEST = 2


_LONG = {Setting(Preset.FAST, 2.5), Setting(Preset.FAST, 2.85)}
_LONGEST = {Setting(Preset.FAST, 3.3), Setting(Preset.REFERENCE)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """A press of the table.

    Attributes:
        depths_m: Where it is judged, in ascending order [m].
    """

    scene: Scene
    indenter: Cylinder | Sphere
    depths_m: tuple[float, ...]
    effort: Effort

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What it is pressed with, the cheapest first."""
        barred = _LONGEST if self.effort < Effort.LONGEST else set()
        barred = barred | _LONG if self.effort < Effort.LONG else barred
        # The paper's mesh is that of the paper's gel.
        barred = barred if self.scene.pad == _GEL.pad else barred | {Setting(Preset.PAPER)}
        return tuple(setting for setting in SETTINGS if setting not in barred)


def _punch(
    diameter_mm: float,
    fillet_mm: float,
    pad: Pad,
    *,
    poisson: float,
    depth_mm: float,
    effort: Effort = Effort.USUAL,
) -> Training:
    indenter = Cylinder(diameter_m=diameter_mm * 1e-3, fillet_m=fillet_mm * 1e-3)
    return _training(indenter, pad, poisson, depth_mm * 1e-3, is_force=False, effort=effort)


def _ball(
    diameter_mm: float,
    pad: Pad,
    *,
    poisson: float,
    depth_mm: float,
    is_force: bool = False,
    effort: Effort = Effort.USUAL,
) -> Training:
    indenter = Sphere(diameter_m=diameter_mm * 1e-3)
    return _training(indenter, pad, poisson, depth_mm * 1e-3, is_force=is_force, effort=effort)


def _training(
    indenter: Cylinder | Sphere,
    pad: Pad,
    poisson: float,
    depth_m: float,
    *,
    is_force: bool,
    effort: Effort,
) -> Training:
    """Return a press.

    Args:
        is_force: On the mesh that a press to a force gets, which is made before its depth is known.
    """
    target = Target(force_n=_ANY_FORCE_N) if is_force else Target(depth_m=depth_m)
    scene = Scene(
        pad=pad,
        material=replace(_GEL.material, poisson=poisson),
        indenter=indenter,
        target=target,
        tolerance=_TOLERANCE,
    )
    depths = tuple(share * depth_m for share in DEPTH_SHARES)
    return Training(scene=scene, indenter=indenter, depths_m=depths, effort=effort)


TRAINING = (
    _punch(4.0, 0.30, _GEL.pad, poisson=0.45, depth_mm=0.40, effort=Effort.LONGEST),
    _ball(8.0, _GEL.pad, poisson=0.45, depth_mm=0.30, effort=Effort.LONGEST),
    _punch(5.0, 0.10, _GEL.pad, poisson=0.48, depth_mm=0.60),
    _ball(15.0, _GEL.pad, poisson=0.48, depth_mm=0.70, effort=Effort.LONG),
    _punch(7.0, 0.25, _GEL.pad, poisson=0.41, depth_mm=0.35, effort=Effort.LONG),
    _ball(6.0, _DISC, poisson=0.42, depth_mm=0.50, is_force=True, effort=Effort.LONG),
    _punch(3.6, 0.12, _DISC, poisson=0.465, depth_mm=0.55),
    _ball(12.0, _BOX, poisson=0.46, depth_mm=0.30, effort=Effort.LONG),
    _punch(6.5, 0.20, _BOX, poisson=0.47, depth_mm=0.30, effort=Effort.LONG),
    _ball(20.0, _DISC, poisson=0.47, depth_mm=0.40, is_force=True),
    _punch(4.8, 0.15, _BOX, poisson=0.43, depth_mm=0.45, effort=Effort.LONG),
    _ball(5.4, _GEL.pad, poisson=0.475, depth_mm=0.45, is_force=True),
    _punch(8.5, 0.40, _DISC, poisson=0.455, depth_mm=0.50),
    _ball(10.0, _GEL.pad, poisson=0.40, depth_mm=0.55),
    _punch(3.0, 0.20, _GEL.pad, poisson=0.485, depth_mm=0.30),
    _ball(17.0, _BOX, poisson=0.44, depth_mm=0.40, is_force=True),
    _punch(5.5, 0.35, _DISC, poisson=0.40, depth_mm=0.65),
    _ball(9.0, _DISC, poisson=0.485, depth_mm=0.25),
)
