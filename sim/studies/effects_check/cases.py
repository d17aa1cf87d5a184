"""Scenes that differ in what they call for, to hold plans against everything switched on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import LawName, Layer, Material, RelaxationTerm
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Motion, Preset, Scene, Target

_GEL = Material(young_pa=0.4e6, poisson=0.48)
_PAD = BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=4e-3)
_BALL = Sphere(diameter_m=10e-3)
_PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCase:
    """A scene and what sets it apart.

    Attributes:
        whole: Hold it against the whole pad, to show what symmetry is worth.
    """

    name: str
    shows: str
    scene: Scene
    whole: bool = False


def effect_cases() -> tuple[EffectCase, ...]:
    """Return the catalogue, all on the coarsest preset so that everything on can be afforded."""
    return (*_presses(), *_tangential(), *_timed(), *_materials(), *_moved())


def _scene(
    indenter: Indenter = _BALL,
    *,
    depth_m: float = 0.1e-3,
    material: Material = _GEL,
    pad: BoxPad = _PAD,
) -> Scene:
    return Scene(
        pad=pad,
        material=material,
        indenter=indenter,
        target=Target(depth_m=depth_m),
        preset=Preset.FAST,
        tolerance=0.02,
    )


def _presses() -> Iterator[EffectCase]:
    yield EffectCase(
        name="shallow",
        shows="a ball pressed 0.1 mm deep, 2.5 % of the pad, where 5 % will do",
        scene=replace(_scene(), tolerance=0.05),
    )
    yield EffectCase(
        name="shallow, tight",
        shows="the same to 0.1 %: small strains are no longer good enough",
        scene=replace(_scene(), tolerance=1e-3),
    )
    yield EffectCase(
        name="deep",
        shows="a punch pressed 0.8 mm deep, 20 % of the pad",
        scene=_scene(_PUNCH, depth_m=0.8e-3),
    )
    yield EffectCase(
        name="by force",
        shows="a ball pressed until it carries 0.1 N; the depth is what is compared",
        scene=replace(_scene(), target=Target(force_n=0.1)),
    )
    yield EffectCase(
        name="off centre",
        shows="a ball beside one middle plane, so that half of the pad is solved",
        scene=replace(_scene(), centre_m=(2e-3, 0.0)),
    )


def _tangential() -> Iterator[EffectCase]:
    yield EffectCase(
        name="bonded",
        shows="a punch glued to the gel",
        scene=replace(_scene(_PUNCH, depth_m=0.3e-3), contact=ContactMode.BONDED),
    )
    yield EffectCase(
        name="rough, straight",
        shows="friction 0.5 under a ball that goes straight down",
        scene=replace(_scene(), contact=ContactMode.FRICTION, friction=0.5),
        whole=True,
    )
    yield EffectCase(
        name="rough, compressible",
        shows="friction 0.5 under a punch on a gel of nu 0.3",
        scene=replace(
            _scene(_PUNCH, material=replace(_GEL, poisson=0.3)),
            contact=ContactMode.FRICTION,
            friction=0.5,
        ),
    )


def _timed() -> Iterator[EffectCase]:
    yield EffectCase(
        name="fast",
        shows="a ball pressed in 0.3 ms, a fifth of the pad's slowest period",
        scene=replace(_scene(), duration_s=3e-4),
    )
    yield EffectCase(
        name="brisk",
        shows="the same in 5 ms: inertia no longer matters",
        scene=replace(_scene(), duration_s=5e-3),
    )
    terms = (RelaxationTerm(share=0.2, time_s=0.05), RelaxationTerm(share=0.1, time_s=0.5))
    lossy = replace(_GEL, relaxation=terms)
    yield EffectCase(
        name="slow and lossy",
        shows="a Prony series of 0.05 s and 0.5 s, pressed in 60 s",
        scene=replace(_scene(material=lossy), duration_s=60.0),
    )
    yield EffectCase(
        name="lossy",
        shows="the same pressed in 0.5 s",
        scene=replace(_scene(material=lossy), duration_s=0.5),
    )


def _materials() -> Iterator[EffectCase]:
    yield EffectCase(
        name="compressible, loose",
        shows="a ball on a gel of nu 0.3 where 35 % will do: linear tetrahedra are enough",
        scene=replace(_scene(material=replace(_GEL, poisson=0.3)), tolerance=0.35),
    )
    yield EffectCase(
        name="incompressible, loose",
        shows="nu 0.495 where 35 % will do: linear tetrahedra would lock",
        scene=replace(_scene(material=replace(_GEL, poisson=0.495)), tolerance=0.35),
    )
    yield EffectCase(
        name="soft and thick",
        shows="10 mm of a gel of 5 kPa: it sags under its weight",
        scene=_scene(
            material=replace(_GEL, young_pa=5e3, density_kg_m3=1200.0),
            pad=replace(_PAD, height_m=10e-3),
        ),
    )
    yield EffectCase(
        name="layered",
        shows="a skin of 0.4 MPa on a base of 0.1 MPa",
        scene=replace(
            _scene(depth_m=0.2e-3),
            layers=(
                Layer(share=0.85, material=replace(_GEL, young_pa=0.1e6)),
                Layer(share=0.15, material=_GEL),
            ),
        ),
    )
    yield EffectCase(
        name="printed law",
        shows="the paper's Eq. 4, which is under tension at rest",
        scene=_scene(material=replace(_GEL, poisson=0.45, law=LawName.PAPER_EQ4)),
    )


def _moved() -> Iterator[EffectCase]:
    yield EffectCase(
        name="slid",
        shows="a ball pressed in, then carried 0.2 mm along x with friction 0.5",
        scene=replace(
            _scene(depth_m=0.3e-3),
            contact=ContactMode.FRICTION,
            friction=0.5,
            motion=Motion(shift_m=(0.2e-3, 0.0)),
        ),
    )
    yield EffectCase(
        name="tilted",
        shows="a punch tilted by 1 degree: no symmetry",
        scene=replace(
            _scene(_PUNCH, depth_m=0.3e-3), motion=Motion(tilt_rad=(0.0, math.radians(1.0)))
        ),
    )
