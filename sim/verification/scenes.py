"""Scenes on which the estimate of the force error was made up, and others on which it is judged."""

from __future__ import annotations

from sim.indenter import Cylinder, Sphere
from sim.pad import BoxPad, DiscPad
from sim.scene import ContactMode, Effect, Layer, Material, Preset, Scene, Target
from sim.verification.refined_press import NamedScene

_FLAT = BoxPad(size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3)
_DISC = DiscPad(radius_m=7e-3, height_m=4e-3)
_DOMED = BoxPad(
    size_x_m=20.75e-3,
    size_y_m=25.25e-3,
    height_m=4e-3,
    dome_radius_x_m=0.105,
    dome_radius_y_m=0.185,
)
_GEL = Material(young_pa=4.35e5, poisson=0.48)
_SOFT = Material(young_pa=1e5, poisson=0.46)
_STIFF = Material(young_pa=4e5, poisson=0.46)


def _named(name: str, scene: Scene) -> NamedScene:
    return NamedScene(name=name, scene=scene)


TRAINING = (
    _named(
        "sharp 4 mm punch, disc 4 mm",
        Scene(
            pad=_DISC,
            material=_GEL,
            indenter=Cylinder(diameter_m=4e-3),
            target=Target(depth_m=0.1e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "5 mm punch, 0.1 mm fillet, domed gel",
        Scene(
            pad=_DOMED,
            material=_GEL,
            indenter=Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
            target=Target(depth_m=0.12e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "8 mm ball, disc",
        Scene(
            pad=_DISC,
            material=_GEL,
            indenter=Sphere(diameter_m=8e-3),
            target=Target(depth_m=0.15e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "bonded 6 mm ball, nu 0.45",
        Scene(
            pad=_FLAT,
            material=Material(young_pa=3e5, poisson=0.45),
            indenter=Sphere(diameter_m=6e-3),
            target=Target(depth_m=0.2e-3),
            contact=ContactMode.BONDED,
            preset=Preset.FAST,
        ),
    ),
    _named(
        "bonded sharp 3 mm punch, nu 0.49",
        Scene(
            pad=_DISC,
            material=Material(young_pa=3e5, poisson=0.49),
            indenter=Cylinder(diameter_m=3e-3),
            target=Target(depth_m=0.1e-3),
            contact=ContactMode.BONDED,
            preset=Preset.FAST,
        ),
    ),
    _named(
        "8 mm ball, stiff skin of 1 mm",
        Scene(
            pad=_FLAT,
            material=_SOFT,
            layers=(Layer(share=0.75, material=_SOFT), Layer(share=0.25, material=_STIFF)),
            indenter=Sphere(diameter_m=8e-3),
            target=Target(depth_m=0.15e-3),
            preset=Preset.FAST,
        ),
    ),
)

HELD_OUT = (
    _named(
        "sharp 4 mm punch, disc 3.5 mm, nu 0.47",
        Scene(
            pad=DiscPad(radius_m=7e-3, height_m=3.5e-3),
            material=Material(young_pa=2e5, poisson=0.47),
            indenter=Cylinder(diameter_m=4e-3),
            target=Target(depth_m=0.1e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "sharp 6 mm punch, box 4.5 mm, nu 0.49",
        Scene(
            pad=BoxPad(size_x_m=22e-3, size_y_m=18e-3, height_m=4.5e-3),
            material=Material(young_pa=3e5, poisson=0.49),
            indenter=Cylinder(diameter_m=6e-3),
            target=Target(depth_m=0.12e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "bonded sharp 5 mm punch, disc 5 mm, nu 0.42",
        Scene(
            pad=DiscPad(radius_m=9e-3, height_m=5e-3),
            material=Material(young_pa=3e5, poisson=0.42),
            indenter=Cylinder(diameter_m=5e-3),
            target=Target(depth_m=0.15e-3),
            contact=ContactMode.BONDED,
            preset=Preset.FAST,
        ),
    ),
    _named(
        "6 mm punch, 0.5 mm fillet, steep dome",
        Scene(
            pad=BoxPad(
                size_x_m=18e-3,
                size_y_m=18e-3,
                height_m=3.5e-3,
                dome_radius_x_m=0.06,
                dome_radius_y_m=0.08,
            ),
            material=Material(young_pa=2.5e5, poisson=0.46),
            indenter=Cylinder(diameter_m=6e-3, fillet_m=0.5e-3),
            target=Target(depth_m=0.15e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "10 mm ball, 0.6 mm deep, nu 0.45",
        Scene(
            pad=DiscPad(radius_m=9e-3, height_m=5e-3),
            material=Material(young_pa=3e5, poisson=0.45),
            indenter=Sphere(diameter_m=10e-3),
            target=Target(depth_m=0.6e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "bonded 5 mm ball, small box, nu 0.48",
        Scene(
            pad=BoxPad(size_x_m=14e-3, size_y_m=14e-3, height_m=3e-3),
            material=Material(young_pa=4e5, poisson=0.48),
            indenter=Sphere(diameter_m=5e-3),
            target=Target(depth_m=0.1e-3),
            contact=ContactMode.BONDED,
            preset=Preset.FAST,
        ),
    ),
    _named(
        "12 mm ball, nu 0.495, preset balanced",
        Scene(
            pad=DiscPad(radius_m=8e-3, height_m=3e-3),
            material=Material(young_pa=3e5, poisson=0.495),
            indenter=Sphere(diameter_m=12e-3),
            target=Target(depth_m=0.1e-3),
            preset=Preset.BALANCED,
        ),
    ),
    _named(
        "7 mm ball, soft skin on a stiff base",
        Scene(
            pad=DiscPad(radius_m=8e-3, height_m=4e-3),
            material=_SOFT,
            layers=(
                Layer(share=0.5, material=Material(young_pa=6e5, poisson=0.47)),
                Layer(share=0.5, material=Material(young_pa=2e5, poisson=0.47)),
            ),
            indenter=Sphere(diameter_m=7e-3),
            target=Target(depth_m=0.15e-3),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "6 mm ball 2 mm off the centre, friction 0.6",
        Scene(
            pad=BoxPad(size_x_m=16e-3, size_y_m=14e-3, height_m=3.5e-3),
            material=Material(young_pa=3e5, poisson=0.46),
            indenter=Sphere(diameter_m=6e-3),
            target=Target(depth_m=0.2e-3),
            centre_m=(2e-3, 0.0),
            contact=ContactMode.FRICTION,
            friction=0.6,
            effects=((Effect.FRICTION, True),),
            preset=Preset.FAST,
        ),
    ),
    _named(
        "4 mm punch, 0.2 mm fillet, three times as stiff skin",
        Scene(
            pad=DiscPad(radius_m=7e-3, height_m=4e-3),
            material=_SOFT,
            layers=(
                Layer(share=0.8, material=_SOFT),
                Layer(share=0.2, material=Material(young_pa=3e5, poisson=0.46)),
            ),
            indenter=Cylinder(diameter_m=4e-3, fillet_m=0.2e-3),
            target=Target(depth_m=0.12e-3),
            preset=Preset.FAST,
        ),
    ),
)
