"""Scenes on which the estimate of the force error was made up, and others on which it is judged."""

from __future__ import annotations

from dataclasses import replace

from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Layer, Material
from sim.scene.pad import BoxPad, DiscPad, Pad
from sim.scene.scene import ContactMode, Effect, Preset, Scene, Target
from sim.studies.verification.against_itself.refined_press import NamedScene

_BONDED = ContactMode.BONDED
_FLAT = BoxPad(size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3)
_DISC = DiscPad(radius_m=7e-3, height_m=4e-3)
_DOMED = BoxPad(
    size_x_m=20.75e-3,
    size_y_m=25.25e-3,
    height_m=4e-3,
    dome_radius_x_m=0.105,
    dome_radius_y_m=0.185,
)
_STEEP = BoxPad(
    size_x_m=18e-3, size_y_m=18e-3, height_m=3.5e-3, dome_radius_x_m=0.06, dome_radius_y_m=0.08
)


def _gel(young_pa: float, poisson: float) -> Material:
    return Material(young_pa=young_pa, poisson=poisson)


def _layers(*layers: tuple[float, Material]) -> tuple[Layer, ...]:
    return tuple(Layer(share=share, material=material) for share, material in layers)


def _named(
    name: str,
    pad: Pad,
    material: Material,
    indenter: Indenter,
    depth_m: float,
    *,
    layers: tuple[Layer, ...] = (),
    contact: ContactMode = ContactMode.FRICTIONLESS,
    preset: Preset = Preset.FAST,
) -> NamedScene:
    scene = Scene(
        pad=pad,
        material=material,
        layers=layers,
        indenter=indenter,
        target=Target(depth_m=depth_m),
        contact=contact,
        preset=preset,
    )
    return NamedScene(name=name, scene=scene)


def _rubbed_aside(named: NamedScene, *, x_m: float, friction: float) -> NamedScene:
    scene = replace(
        named.scene,
        centre_m=(x_m, 0.0),
        contact=ContactMode.FRICTION,
        friction=friction,
        effects=((Effect.FRICTION, True),),
    )
    return replace(named, scene=scene)


_SOFT = _gel(1e5, 0.46)

TRAINING = (
    _named(
        "sharp 4 mm punch, disc 4 mm", _DISC, _gel(4.35e5, 0.48), Cylinder(diameter_m=4e-3), 0.1e-3
    ),
    _named(
        "5 mm punch, 0.1 mm fillet, domed gel",
        _DOMED,
        _gel(4.35e5, 0.48),
        Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
        0.12e-3,
    ),
    _named("8 mm ball, disc", _DISC, _gel(4.35e5, 0.48), Sphere(diameter_m=8e-3), 0.15e-3),
    _named(
        "bonded 6 mm ball, nu 0.45",
        _FLAT,
        _gel(3e5, 0.45),
        Sphere(diameter_m=6e-3),
        0.2e-3,
        contact=_BONDED,
    ),
    _named(
        "bonded sharp 3 mm punch, nu 0.49",
        _DISC,
        _gel(3e5, 0.49),
        Cylinder(diameter_m=3e-3),
        0.1e-3,
        contact=_BONDED,
    ),
    _named(
        "8 mm ball, stiff skin of 1 mm",
        _FLAT,
        _SOFT,
        Sphere(diameter_m=8e-3),
        0.15e-3,
        layers=_layers((0.75, _SOFT), (0.25, _gel(4e5, 0.46))),
    ),
)

HELD_OUT = (
    _named(
        "sharp 4 mm punch, disc 3.5 mm, nu 0.47",
        DiscPad(radius_m=7e-3, height_m=3.5e-3),
        _gel(2e5, 0.47),
        Cylinder(diameter_m=4e-3),
        0.1e-3,
    ),
    _named(
        "sharp 6 mm punch, box 4.5 mm, nu 0.49",
        BoxPad(size_x_m=22e-3, size_y_m=18e-3, height_m=4.5e-3),
        _gel(3e5, 0.49),
        Cylinder(diameter_m=6e-3),
        0.12e-3,
    ),
    _named(
        "bonded sharp 5 mm punch, disc 5 mm, nu 0.42",
        DiscPad(radius_m=9e-3, height_m=5e-3),
        _gel(3e5, 0.42),
        Cylinder(diameter_m=5e-3),
        0.15e-3,
        contact=_BONDED,
    ),
    _named(
        "6 mm punch, 0.5 mm fillet, steep dome",
        _STEEP,
        _gel(2.5e5, 0.46),
        Cylinder(diameter_m=6e-3, fillet_m=0.5e-3),
        0.15e-3,
    ),
    _named(
        "10 mm ball, 0.6 mm deep, nu 0.45",
        DiscPad(radius_m=9e-3, height_m=5e-3),
        _gel(3e5, 0.45),
        Sphere(diameter_m=10e-3),
        0.6e-3,
    ),
    _named(
        "bonded 5 mm ball, small box, nu 0.48",
        BoxPad(size_x_m=14e-3, size_y_m=14e-3, height_m=3e-3),
        _gel(4e5, 0.48),
        Sphere(diameter_m=5e-3),
        0.1e-3,
        contact=_BONDED,
    ),
    _named(
        "12 mm ball, nu 0.495, preset balanced",
        DiscPad(radius_m=8e-3, height_m=3e-3),
        _gel(3e5, 0.495),
        Sphere(diameter_m=12e-3),
        0.1e-3,
        preset=Preset.BALANCED,
    ),
    _named(
        "7 mm ball, soft skin on a stiff base",
        DiscPad(radius_m=8e-3, height_m=4e-3),
        _SOFT,
        Sphere(diameter_m=7e-3),
        0.15e-3,
        layers=_layers((0.5, _gel(6e5, 0.47)), (0.5, _gel(2e5, 0.47))),
    ),
    _rubbed_aside(
        _named(
            "6 mm ball 2 mm off the centre, friction 0.6",
            BoxPad(size_x_m=16e-3, size_y_m=14e-3, height_m=3.5e-3),
            _gel(3e5, 0.46),
            Sphere(diameter_m=6e-3),
            0.2e-3,
        ),
        x_m=2e-3,
        friction=0.6,
    ),
    _named(
        "4 mm punch, 0.2 mm fillet, three times as stiff skin",
        DiscPad(radius_m=7e-3, height_m=4e-3),
        _SOFT,
        Cylinder(diameter_m=4e-3, fillet_m=0.2e-3),
        0.12e-3,
        layers=_layers((0.8, _SOFT), (0.2, _gel(3e5, 0.46))),
    ),
)
