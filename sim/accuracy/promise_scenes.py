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


_DISC = DiscPad(radius_m=9e-3, height_m=4e-3)
_BOX = BoxPad(size_x_m=18e-3, size_y_m=20e-3, height_m=3.5e-3)

HELD_OUT = (
    Promise(
        name="3 mm punch, 0.1 mm fillet, nu 0.47, 0.2 mm deep",
        scene=_gelsight(
            Cylinder(diameter_m=3e-3, fillet_m=0.1e-3), Target(depth_m=0.2e-3), poisson=0.47
        ),
        tolerance=Tolerance(relative=0.05),
    ),
    Promise(
        name="6 mm punch, 0.2 mm fillet, disc 4 mm, nu 0.46, 0.4 mm deep",
        scene=Scene(
            pad=_DISC,
            material=Material(young_pa=3e5, poisson=0.46),
            indenter=Cylinder(diameter_m=6e-3, fillet_m=0.2e-3),
            target=Target(depth_m=0.4e-3),
        ),
        tolerance=Tolerance(relative=0.02),
    ),
    Promise(
        name="5 mm punch, 0.15 mm fillet, nu 0.47, to 1.8 N",
        scene=_gelsight(
            Cylinder(diameter_m=5e-3, fillet_m=0.15e-3), Target(force_n=1.8), poisson=0.47
        ),
        tolerance=Tolerance(force_n=0.05),
    ),
    Promise(
        name="7 mm punch, 0.5 mm fillet, nu 0.44, to 3 N",
        scene=_gelsight(
            Cylinder(diameter_m=7e-3, fillet_m=0.5e-3), Target(force_n=3.0), poisson=0.44
        ),
        tolerance=Tolerance(force_n=0.1),
    ),
    Promise(
        name="10 mm ball, nu 0.47, 0.4 mm deep",
        scene=_gelsight(Sphere(diameter_m=10e-3), Target(depth_m=0.4e-3), poisson=0.47),
        tolerance=Tolerance(relative=0.02),
    ),
    Promise(
        name="6 mm ball, box 3.5 mm, nu 0.42, 0.25 mm deep",
        scene=Scene(
            pad=_BOX,
            material=Material(young_pa=2.5e5, poisson=0.42),
            indenter=Sphere(diameter_m=6e-3),
            target=Target(depth_m=0.25e-3),
        ),
        tolerance=Tolerance(relative=0.03),
    ),
    Promise(
        name="20 mm ball, nu 0.48, 0.3 mm deep",
        scene=_gelsight(Sphere(diameter_m=20e-3), Target(depth_m=0.3e-3), poisson=0.48),
        tolerance=Tolerance(relative=0.01),
    ),
    Promise(
        name="12 mm ball, nu 0.46, to 1 N",
        scene=_gelsight(Sphere(diameter_m=12e-3), Target(force_n=1.0), poisson=0.46),
        tolerance=Tolerance(force_n=0.02),
    ),
    Promise(
        name="4 mm punch, 0.2 mm fillet, disc 4 mm, nu 0.46, 0.5 mm deep",
        scene=Scene(
            pad=_DISC,
            material=Material(young_pa=2e5, poisson=0.46),
            indenter=Cylinder(diameter_m=4e-3, fillet_m=0.2e-3),
            target=Target(depth_m=0.5e-3),
        ),
        tolerance=Tolerance(relative=0.1),
    ),
    Promise(
        name="9 mm ball, nu 0.4, 0.5 mm deep",
        scene=_gelsight(Sphere(diameter_m=9e-3), Target(depth_m=0.5e-3), poisson=0.4),
        tolerance=Tolerance(relative=0.05),
    ),
)
