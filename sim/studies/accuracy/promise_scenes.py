"""Scenes and tolerances on which the choice of settings is judged; it never saw them.

``FRESH`` decides. ``JUDGED_BEFORE`` were, and what they gave led to another method or was looked at
while it was made: none of their numbers is in the table, but they are no longer unseen.
``JUDGED_LAST`` are the ten of them that were fresh before ``FRESH``. Every ten have the same
tolerances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.error.tolerance import Tolerance
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import Scene, Target
from sim.sensor.sensor import load_sensor


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """A scene, what it is called in a table, and how well its F_z must be known."""

    name: str
    scene: Scene
    tolerance: Tolerance


def _gelsight(indenter: Indenter, target: Target, *, poisson: float) -> Scene:
    sensor = load_sensor("gelsight-mini")
    return Scene(
        pad=sensor.pad,
        material=replace(sensor.material, poisson=poisson),
        indenter=indenter,
        target=target,
        sensor=sensor.name,
    )


_DISC = DiscPad(radius_m=10e-3, height_m=5e-3)
_BOX = BoxPad(size_x_m=18e-3, size_y_m=20e-3, height_m=3.5e-3)


def _punch(diameter_m: float, fillet_m: float) -> Cylinder:
    return Cylinder(diameter_m=diameter_m, fillet_m=fillet_m)


_FIRST = (
    Promise(
        name="4.5 mm punch, 0.2 mm fillet, nu 0.45, 0.35 mm deep",
        scene=_gelsight(_punch(4.5e-3, 0.2e-3), Target(depth_m=0.35e-3), poisson=0.45),
        tolerance=Tolerance(relative=0.025),
    ),
    Promise(
        name="6 mm punch, 0.3 mm fillet, disc 5 mm, nu 0.47, 0.3 mm deep",
        scene=Scene(
            pad=_DISC,
            material=Material(young_pa=3e5, poisson=0.47),
            indenter=_punch(6e-3, 0.3e-3),
            target=Target(depth_m=0.3e-3),
        ),
        tolerance=Tolerance(relative=0.015),
    ),
    Promise(
        name="3.5 mm punch, 0.15 mm fillet, nu 0.48, to 1 N",
        scene=_gelsight(_punch(3.5e-3, 0.15e-3), Target(force_n=1.0), poisson=0.48),
        tolerance=Tolerance(force_n=0.03),
    ),
    Promise(
        name="8 mm punch, 0.3 mm fillet, nu 0.42, to 4 N",
        scene=_gelsight(_punch(8e-3, 0.3e-3), Target(force_n=4.0), poisson=0.42),
        tolerance=Tolerance(force_n=0.05),
    ),
    Promise(
        name="5 mm punch, 0.25 mm fillet, box 3.5 mm, nu 0.46, 0.6 mm deep",
        scene=Scene(
            pad=_BOX,
            material=Material(young_pa=2e5, poisson=0.46),
            indenter=_punch(5e-3, 0.25e-3),
            target=Target(depth_m=0.6e-3),
        ),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="11 mm ball, nu 0.46, 0.35 mm deep",
        scene=_gelsight(Sphere(diameter_m=11e-3), Target(depth_m=0.35e-3), poisson=0.46),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="7 mm ball, disc 5 mm, nu 0.44, 0.2 mm deep",
        scene=Scene(
            pad=_DISC,
            material=Material(young_pa=2.5e5, poisson=0.44),
            indenter=Sphere(diameter_m=7e-3),
            target=Target(depth_m=0.2e-3),
        ),
        tolerance=Tolerance(relative=0.02),
    ),
    Promise(
        name="14 mm ball, nu 0.47, to 1.5 N",
        scene=_gelsight(Sphere(diameter_m=14e-3), Target(force_n=1.5), poisson=0.47),
        tolerance=Tolerance(force_n=0.03),
    ),
    Promise(
        name="18 mm ball, box 3.5 mm, nu 0.48, 0.25 mm deep",
        scene=Scene(
            pad=_BOX,
            material=Material(young_pa=3e5, poisson=0.48),
            indenter=Sphere(diameter_m=18e-3),
            target=Target(depth_m=0.25e-3),
        ),
        tolerance=Tolerance(relative=0.03),
    ),
    Promise(
        name="5 mm ball, nu 0.41, 0.4 mm deep",
        scene=_gelsight(Sphere(diameter_m=5e-3), Target(depth_m=0.4e-3), poisson=0.41),
        tolerance=Tolerance(relative=0.06),
    ),
)

_SECOND_DISC = DiscPad(radius_m=9.5e-3, height_m=4.4e-3)
_SECOND_BOX = BoxPad(size_x_m=19e-3, size_y_m=22e-3, height_m=3.6e-3)


def _bare(pad: BoxPad | DiscPad, indenter: Indenter, target: Target, *, poisson: float) -> Scene:
    material = Material(young_pa=3.5e5, poisson=poisson)
    return Scene(pad=pad, material=material, indenter=indenter, target=target)


_SECOND = (
    Promise(
        name="5.2 mm punch, 0.18 mm fillet, nu 0.47, 0.45 mm deep",
        scene=_gelsight(_punch(5.2e-3, 0.18e-3), Target(depth_m=0.45e-3), poisson=0.47),
        tolerance=Tolerance(relative=0.025),
    ),
    Promise(
        name="4.2 mm punch, 0.25 mm fillet, box 3.6 mm, nu 0.44, 0.28 mm deep",
        scene=_bare(_SECOND_BOX, _punch(4.2e-3, 0.25e-3), Target(depth_m=0.28e-3), poisson=0.44),
        tolerance=Tolerance(relative=0.015),
    ),
    Promise(
        name="6.8 mm punch, 0.15 mm fillet, nu 0.455, to 2.5 N",
        scene=_gelsight(_punch(6.8e-3, 0.15e-3), Target(force_n=2.5), poisson=0.455),
        tolerance=Tolerance(force_n=0.075),
    ),
    Promise(
        name="3.8 mm punch, 0.1 mm fillet, disc 4.4 mm, nu 0.425, to 0.8 N",
        scene=_bare(_SECOND_DISC, _punch(3.8e-3, 0.1e-3), Target(force_n=0.8), poisson=0.425),
        tolerance=Tolerance(force_n=0.01),
    ),
    Promise(
        name="7.5 mm punch, 0.35 mm fillet, disc 4.4 mm, nu 0.478, 0.5 mm deep",
        scene=_bare(_SECOND_DISC, _punch(7.5e-3, 0.35e-3), Target(depth_m=0.5e-3), poisson=0.478),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="13 mm ball, disc 4.4 mm, nu 0.45, 0.4 mm deep",
        scene=_bare(_SECOND_DISC, Sphere(diameter_m=13e-3), Target(depth_m=0.4e-3), poisson=0.45),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="9.5 mm ball, box 3.6 mm, nu 0.43, to 0.6 N",
        scene=_bare(_SECOND_BOX, Sphere(diameter_m=9.5e-3), Target(force_n=0.6), poisson=0.43),
        tolerance=Tolerance(force_n=0.012),
    ),
    Promise(
        name="6.5 mm ball, nu 0.465, 0.3 mm deep",
        scene=_gelsight(Sphere(diameter_m=6.5e-3), Target(depth_m=0.3e-3), poisson=0.465),
        tolerance=Tolerance(relative=0.02),
    ),
    Promise(
        name="16 mm ball, nu 0.41, to 1.2 N",
        scene=_gelsight(Sphere(diameter_m=16e-3), Target(force_n=1.2), poisson=0.41),
        tolerance=Tolerance(force_n=0.036),
    ),
    Promise(
        name="7.5 mm ball, disc 4.4 mm, nu 0.48, 0.35 mm deep",
        scene=_bare(_SECOND_DISC, Sphere(diameter_m=7.5e-3), Target(depth_m=0.35e-3), poisson=0.48),
        tolerance=Tolerance(relative=0.06),
    ),
)

_THIRD_DISC = DiscPad(radius_m=10.5e-3, height_m=4.2e-3)
_THIRD_BOX = BoxPad(size_x_m=20e-3, size_y_m=23e-3, height_m=3.8e-3)

_THIRD = (
    Promise(
        name="4.6 mm punch, 0.22 mm fillet, nu 0.46, 0.3 mm deep",
        scene=_gelsight(_punch(4.6e-3, 0.22e-3), Target(depth_m=0.3e-3), poisson=0.46),
        tolerance=Tolerance(relative=0.015),
    ),
    Promise(
        name="6.2 mm punch, 0.3 mm fillet, box 3.8 mm, nu 0.475, to 3 N",
        scene=_bare(_THIRD_BOX, _punch(6.2e-3, 0.3e-3), Target(force_n=3.0), poisson=0.475),
        tolerance=Tolerance(force_n=0.09),
    ),
    Promise(
        name="5.8 mm punch, 0.16 mm fillet, disc 4.2 mm, nu 0.435, 0.45 mm deep",
        scene=_bare(_THIRD_DISC, _punch(5.8e-3, 0.16e-3), Target(depth_m=0.45e-3), poisson=0.435),
        tolerance=Tolerance(relative=0.025),
    ),
    Promise(
        name="3.4 mm punch, 0.14 mm fillet, nu 0.472, 0.4 mm deep",
        scene=_gelsight(_punch(3.4e-3, 0.14e-3), Target(depth_m=0.4e-3), poisson=0.472),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="7.8 mm punch, 0.28 mm fillet, nu 0.405, to 3.2 N",
        scene=_gelsight(_punch(7.8e-3, 0.28e-3), Target(force_n=3.2), poisson=0.405),
        tolerance=Tolerance(force_n=0.04),
    ),
    Promise(
        name="12.5 mm ball, nu 0.475, 0.45 mm deep",
        scene=_gelsight(Sphere(diameter_m=12.5e-3), Target(depth_m=0.45e-3), poisson=0.475),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="8.6 mm ball, disc 4.2 mm, nu 0.44, to 0.5 N",
        scene=_bare(_THIRD_DISC, Sphere(diameter_m=8.6e-3), Target(force_n=0.5), poisson=0.44),
        tolerance=Tolerance(force_n=0.01),
    ),
    Promise(
        name="19 mm ball, nu 0.45, 0.3 mm deep",
        scene=_gelsight(Sphere(diameter_m=19e-3), Target(depth_m=0.3e-3), poisson=0.45),
        tolerance=Tolerance(relative=0.03),
    ),
    Promise(
        name="5.6 mm ball, box 3.8 mm, nu 0.46, 0.35 mm deep",
        scene=_bare(_THIRD_BOX, Sphere(diameter_m=5.6e-3), Target(depth_m=0.35e-3), poisson=0.46),
        tolerance=Tolerance(relative=0.06),
    ),
    Promise(
        name="10.5 mm ball, box 3.8 mm, nu 0.42, 0.4 mm deep",
        scene=_bare(_THIRD_BOX, Sphere(diameter_m=10.5e-3), Target(depth_m=0.4e-3), poisson=0.42),
        tolerance=Tolerance(relative=0.02),
    ),
)

JUDGED_BEFORE = (*_FIRST, *_SECOND, *_THIRD)
JUDGED_LAST = _THIRD

_FRESH_DISC = DiscPad(radius_m=10.8e-3, height_m=4.8e-3)
_FRESH_BOX = BoxPad(size_x_m=19.5e-3, size_y_m=21.5e-3, height_m=3.3e-3)

FRESH = (
    Promise(
        name="4.4 mm punch, 0.18 mm fillet, nu 0.455, 0.33 mm deep",
        scene=_gelsight(_punch(4.4e-3, 0.18e-3), Target(depth_m=0.33e-3), poisson=0.455),
        tolerance=Tolerance(relative=0.015),
    ),
    Promise(
        name="6.6 mm punch, 0.32 mm fillet, box 3.3 mm, nu 0.468, to 2.4 N",
        scene=_bare(_FRESH_BOX, _punch(6.6e-3, 0.32e-3), Target(force_n=2.4), poisson=0.468),
        tolerance=Tolerance(force_n=0.072),
    ),
    Promise(
        name="5.4 mm punch, 0.13 mm fillet, disc 4.8 mm, nu 0.43, 0.5 mm deep",
        scene=_bare(_FRESH_DISC, _punch(5.4e-3, 0.13e-3), Target(depth_m=0.5e-3), poisson=0.43),
        tolerance=Tolerance(relative=0.025),
    ),
    Promise(
        name="3.2 mm punch, 0.16 mm fillet, nu 0.478, 0.35 mm deep",
        scene=_gelsight(_punch(3.2e-3, 0.16e-3), Target(depth_m=0.35e-3), poisson=0.478),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="7.2 mm punch, 0.24 mm fillet, nu 0.415, to 2.8 N",
        scene=_gelsight(_punch(7.2e-3, 0.24e-3), Target(force_n=2.8), poisson=0.415),
        tolerance=Tolerance(force_n=0.035),
    ),
    Promise(
        name="11.5 mm ball, nu 0.465, 0.5 mm deep",
        scene=_gelsight(Sphere(diameter_m=11.5e-3), Target(depth_m=0.5e-3), poisson=0.465),
        tolerance=Tolerance(relative=0.04),
    ),
    Promise(
        name="8.2 mm ball, disc 4.8 mm, nu 0.445, to 0.4 N",
        scene=_bare(_FRESH_DISC, Sphere(diameter_m=8.2e-3), Target(force_n=0.4), poisson=0.445),
        tolerance=Tolerance(force_n=0.008),
    ),
    Promise(
        name="17.5 mm ball, nu 0.455, 0.35 mm deep",
        scene=_gelsight(Sphere(diameter_m=17.5e-3), Target(depth_m=0.35e-3), poisson=0.455),
        tolerance=Tolerance(relative=0.03),
    ),
    Promise(
        name="6.2 mm ball, box 3.3 mm, nu 0.47, 0.3 mm deep",
        scene=_bare(_FRESH_BOX, Sphere(diameter_m=6.2e-3), Target(depth_m=0.3e-3), poisson=0.47),
        tolerance=Tolerance(relative=0.06),
    ),
    Promise(
        name="9.8 mm ball, box 3.3 mm, nu 0.425, 0.38 mm deep",
        scene=_bare(_FRESH_BOX, Sphere(diameter_m=9.8e-3), Target(depth_m=0.38e-3), poisson=0.425),
        tolerance=Tolerance(relative=0.02),
    ),
)
