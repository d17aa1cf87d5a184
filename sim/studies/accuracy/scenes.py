"""Scenes: those that a tolerance's belief is measured on, and held-out ones that it is judged on.

``HELD_OUT`` decides. ``SEEN_BEFORE`` had that part earlier and were looked at while the method was
made: none of their numbers is in the table, but they are no longer unseen. Both ten have the same
tolerances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

from sim.error.measured_errors import SETTINGS, Setting
from sim.error.tolerance import Tolerance
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad, DiscPad, Pad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor

DEPTH_SHARES = (0.4, 0.7, 1.0)
# No effect is left out.
_TRAINING_TOLERANCE = 2e-4
_ANY_FORCE_N = 1.0
_HELD_OUT_YOUNG_PA = 3.5e5
_GEL = load_sensor("gelsight-mini")


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


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A scene that had no part in the table, and how well its F_z must be known."""

    scene: Scene
    tolerance: Tolerance

    @property
    def name(self) -> str:
        """Indenter, pad unless it is a sensor's, Poisson's ratio and target, for a table."""
        body, pad, target = self.scene.indenter, self.scene.pad, self.scene.target
        words = [f"{body.diameter_m * 1e3:g} mm ball"] if isinstance(body, Sphere) else []
        if isinstance(body, Cylinder):
            words += [f"{body.diameter_m * 1e3:g} mm punch", f"{body.fillet_m * 1e3:g} mm fillet"]
        if isinstance(pad, BoxPad | DiscPad) and not self.scene.sensor:
            kind = "box" if isinstance(pad, BoxPad) else "disc"
            words.append(f"{kind} {pad.height_m * 1e3:g} mm")
        words.append(f"nu {self.scene.material.poisson:g}")
        if target.depth_m is not None:
            words.append(f"{target.depth_m * 1e3:g} mm deep")
        else:
            words.append(f"to {target.force_n:g} N")
        return ", ".join(words)


def _punch(diameter_m: float, fillet_m: float) -> Cylinder:
    return Cylinder(diameter_m=diameter_m, fillet_m=fillet_m)


def _ball(diameter_m: float) -> Sphere:
    return Sphere(diameter_m=diameter_m)


def _train(
    indenter: Cylinder | Sphere,
    pad: Pad,
    *,
    nu: float,
    depth_m: float,
    is_force: bool = False,
    effort: Effort = Effort.USUAL,
) -> Training:
    """Return a press.

    Args:
        is_force: On the mesh that a press to a force gets, which is made before its depth is known.
    """
    scene = Scene(
        pad=pad,
        material=replace(_GEL.material, poisson=nu),
        indenter=indenter,
        target=Target(force_n=_ANY_FORCE_N) if is_force else Target(depth_m=depth_m),
        tolerance=_TRAINING_TOLERANCE,
    )
    depths = tuple(share * depth_m for share in DEPTH_SHARES)
    return Training(scene=scene, indenter=indenter, depths_m=depths, effort=effort)


def _on_gel(
    indenter: Cylinder | Sphere, target: Target, tolerance: Tolerance, *, nu: float
) -> HeldOut:
    material = replace(_GEL.material, poisson=nu)
    scene = Scene(
        pad=_GEL.pad, material=material, indenter=indenter, target=target, sensor=_GEL.name
    )
    return HeldOut(scene, tolerance)


def _on_pad(
    pad: Pad, indenter: Cylinder | Sphere, target: Target, tolerance: Tolerance, *, nu: float
) -> HeldOut:
    material = Material(young_pa=_HELD_OUT_YOUNG_PA, poisson=nu)
    return HeldOut(Scene(pad=pad, material=material, indenter=indenter, target=target), tolerance)


def _to(force_n: float) -> Target:
    return Target(force_n=force_n)


def _deep(depth_m: float) -> Target:
    return Target(depth_m=depth_m)


def _newtons(force_n: float) -> Tolerance:
    return Tolerance(force_n=force_n)


def _share(relative: float) -> Tolerance:
    return Tolerance(relative=relative)


_DISC = DiscPad(radius_m=11e-3, height_m=4.6e-3)
_BOX = BoxPad(size_x_m=22e-3, size_y_m=19e-3, height_m=3.1e-3)

TRAINING = (
    _train(_punch(4e-3, 0.3e-3), _GEL.pad, nu=0.45, depth_m=0.4e-3, effort=Effort.LONGEST),
    _train(_ball(8e-3), _GEL.pad, nu=0.45, depth_m=0.3e-3, effort=Effort.LONGEST),
    _train(_punch(5e-3, 0.1e-3), _GEL.pad, nu=0.48, depth_m=0.6e-3),
    _train(_ball(15e-3), _GEL.pad, nu=0.48, depth_m=0.7e-3, effort=Effort.LONG),
    _train(_punch(7e-3, 0.25e-3), _GEL.pad, nu=0.41, depth_m=0.35e-3, effort=Effort.LONG),
    _train(_ball(6e-3), _DISC, nu=0.42, depth_m=0.5e-3, is_force=True, effort=Effort.LONG),
    _train(_punch(3.6e-3, 0.12e-3), _DISC, nu=0.465, depth_m=0.55e-3),
    _train(_ball(12e-3), _BOX, nu=0.46, depth_m=0.3e-3, effort=Effort.LONG),
    _train(_punch(6.5e-3, 0.2e-3), _BOX, nu=0.47, depth_m=0.3e-3, effort=Effort.LONG),
    _train(_ball(20e-3), _DISC, nu=0.47, depth_m=0.4e-3, is_force=True),
    _train(_punch(4.8e-3, 0.15e-3), _BOX, nu=0.43, depth_m=0.45e-3, effort=Effort.LONG),
    _train(_ball(5.4e-3), _GEL.pad, nu=0.475, depth_m=0.45e-3, is_force=True),
    _train(_punch(8.5e-3, 0.4e-3), _DISC, nu=0.455, depth_m=0.5e-3),
    _train(_ball(10e-3), _GEL.pad, nu=0.4, depth_m=0.55e-3),
    _train(_punch(3e-3, 0.2e-3), _GEL.pad, nu=0.485, depth_m=0.3e-3),
    _train(_ball(17e-3), _BOX, nu=0.44, depth_m=0.4e-3, is_force=True),
    _train(_punch(5.5e-3, 0.35e-3), _DISC, nu=0.4, depth_m=0.65e-3),
    _train(_ball(9e-3), _DISC, nu=0.485, depth_m=0.25e-3),
)

_SEEN_DISC = DiscPad(radius_m=10.5e-3, height_m=4.2e-3)
_SEEN_BOX = BoxPad(size_x_m=20e-3, size_y_m=23e-3, height_m=3.8e-3)

SEEN_BEFORE = (
    _on_gel(_punch(4.6e-3, 0.22e-3), _deep(0.3e-3), _share(0.015), nu=0.46),
    _on_pad(_SEEN_BOX, _punch(6.2e-3, 0.3e-3), _to(3.0), _newtons(0.09), nu=0.475),
    _on_pad(_SEEN_DISC, _punch(5.8e-3, 0.16e-3), _deep(0.45e-3), _share(0.025), nu=0.435),
    _on_gel(_punch(3.4e-3, 0.14e-3), _deep(0.4e-3), _share(0.04), nu=0.472),
    _on_gel(_punch(7.8e-3, 0.28e-3), _to(3.2), _newtons(0.04), nu=0.405),
    _on_gel(_ball(12.5e-3), _deep(0.45e-3), _share(0.04), nu=0.475),
    _on_pad(_SEEN_DISC, _ball(8.6e-3), _to(0.5), _newtons(0.01), nu=0.44),
    _on_gel(_ball(19e-3), _deep(0.3e-3), _share(0.03), nu=0.45),
    _on_pad(_SEEN_BOX, _ball(5.6e-3), _deep(0.35e-3), _share(0.06), nu=0.46),
    _on_pad(_SEEN_BOX, _ball(10.5e-3), _deep(0.4e-3), _share(0.02), nu=0.42),
)

_FRESH_DISC = DiscPad(radius_m=10.8e-3, height_m=4.8e-3)
_FRESH_BOX = BoxPad(size_x_m=19.5e-3, size_y_m=21.5e-3, height_m=3.3e-3)

HELD_OUT = (
    _on_gel(_punch(4.4e-3, 0.18e-3), _deep(0.33e-3), _share(0.015), nu=0.455),
    _on_pad(_FRESH_BOX, _punch(6.6e-3, 0.32e-3), _to(2.4), _newtons(0.072), nu=0.468),
    _on_pad(_FRESH_DISC, _punch(5.4e-3, 0.13e-3), _deep(0.5e-3), _share(0.025), nu=0.43),
    _on_gel(_punch(3.2e-3, 0.16e-3), _deep(0.35e-3), _share(0.04), nu=0.478),
    _on_gel(_punch(7.2e-3, 0.24e-3), _to(2.8), _newtons(0.035), nu=0.415),
    _on_gel(_ball(11.5e-3), _deep(0.5e-3), _share(0.04), nu=0.465),
    _on_pad(_FRESH_DISC, _ball(8.2e-3), _to(0.4), _newtons(0.008), nu=0.445),
    _on_gel(_ball(17.5e-3), _deep(0.35e-3), _share(0.03), nu=0.455),
    _on_pad(_FRESH_BOX, _ball(6.2e-3), _deep(0.3e-3), _share(0.06), nu=0.47),
    _on_pad(_FRESH_BOX, _ball(9.8e-3), _deep(0.38e-3), _share(0.02), nu=0.425),
)
