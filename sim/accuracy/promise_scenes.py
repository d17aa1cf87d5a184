"""Scenes and tolerances on which the choice of a preset is judged; it never saw them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.indenter import Cylinder, Indenter, Sphere
from sim.pad import BoxPad, DiscPad
from sim.scene import Material, Scene, Target
from sim.sensor import load_sensor
from sim.tolerance import Tolerance


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


HELD_OUT = (
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
