"""Scenes that differ in what they call for, to hold plans against everything switched on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName, Layer, Material, RelaxationTerm
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Motion, Preset, Scene, Target

_GEL = Material(young_pa=0.4e6, poisson=0.48)
_PAD = BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=4e-3)
# All on the coarsest preset, so that everything on can be afforded.
_BALL = Scene(
    pad=_PAD,
    material=_GEL,
    indenter=Sphere(diameter_m=10e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.FAST,
    tolerance=0.02,
)
_PUNCH = replace(_BALL, indenter=Cylinder(diameter_m=5e-3, fillet_m=0.5e-3))
_DEEPER = Target(depth_m=0.3e-3)
_TERMS = (RelaxationTerm(share=0.2, time_s=0.05), RelaxationTerm(share=0.1, time_s=0.5))
_LOSSY = replace(_BALL, material=replace(_GEL, relaxation=_TERMS))
_COMPRESSIBLE = replace(_GEL, poisson=0.3)


@dataclass(frozen=True, slots=True)
class EffectCase:
    """A scene and what sets it apart.

    Attributes:
        whole: Hold it against the whole pad, to show what symmetry is worth.
    """

    name: str
    shows: str
    scene: Scene
    whole: bool = False


def _rough(scene: Scene) -> Scene:
    return replace(scene, contact=ContactMode.FRICTION, friction=0.5)


EFFECT_CASES = (
    EffectCase(
        "shallow",
        "a ball pressed 0.1 mm deep, 2.5 % of the pad, where 5 % will do",
        replace(_BALL, tolerance=0.05),
    ),
    EffectCase(
        "shallow, tight",
        "the same to 0.1 %: small strains are no longer good enough",
        replace(_BALL, tolerance=1e-3),
    ),
    EffectCase(
        "deep",
        "a punch pressed 0.8 mm deep, 20 % of the pad",
        replace(_PUNCH, target=Target(depth_m=0.8e-3)),
    ),
    EffectCase(
        "by force",
        "a ball pressed until it carries 0.1 N; the depth is what is compared",
        replace(_BALL, target=Target(force_n=0.1)),
    ),
    EffectCase(
        "off centre",
        "a ball beside one middle plane, so that half of the pad is solved",
        replace(_BALL, centre_m=(2e-3, 0.0)),
    ),
    EffectCase(
        "bonded",
        "a punch glued to the gel",
        replace(_PUNCH, target=_DEEPER, contact=ContactMode.BONDED),
    ),
    EffectCase(
        "rough, straight",
        "friction 0.5 under a ball that goes straight down",
        _rough(_BALL),
        whole=True,
    ),
    EffectCase(
        "rough, compressible",
        "friction 0.5 under a punch on a gel of nu 0.3",
        _rough(replace(_PUNCH, material=_COMPRESSIBLE)),
    ),
    EffectCase(
        "fast",
        "a ball pressed in 0.3 ms, a fifth of the pad's slowest period",
        replace(_BALL, duration_s=3e-4),
    ),
    EffectCase(
        "brisk",
        "the same in 5 ms: inertia no longer matters",
        replace(_BALL, duration_s=5e-3),
    ),
    EffectCase(
        "slow and lossy",
        "a Prony series of 0.05 s and 0.5 s, pressed in 60 s",
        replace(_LOSSY, duration_s=60.0),
    ),
    EffectCase("lossy", "the same pressed in 0.5 s", replace(_LOSSY, duration_s=0.5)),
    EffectCase(
        "compressible, loose",
        "a ball on a gel of nu 0.3 where 35 % will do: linear tetrahedra are enough",
        replace(_BALL, material=_COMPRESSIBLE, tolerance=0.35),
    ),
    EffectCase(
        "incompressible, loose",
        "nu 0.495 where 35 % will do: linear tetrahedra would lock",
        replace(_BALL, material=replace(_GEL, poisson=0.495), tolerance=0.35),
    ),
    EffectCase(
        "soft and thick",
        "10 mm of a gel of 5 kPa: it sags under its weight",
        replace(
            _BALL,
            material=replace(_GEL, young_pa=5e3, density_kg_m3=1200.0),
            pad=replace(_PAD, height_m=10e-3),
        ),
    ),
    EffectCase(
        "layered",
        "a skin of 0.4 MPa on a base of 0.1 MPa",
        replace(
            _BALL,
            target=Target(depth_m=0.2e-3),
            layers=(
                Layer(share=0.85, material=replace(_GEL, young_pa=0.1e6)),
                Layer(share=0.15, material=_GEL),
            ),
        ),
    ),
    EffectCase(
        "printed law",
        "the paper's Eq. 4, which is under tension at rest",
        replace(_BALL, material=replace(_GEL, poisson=0.45, law=LawName.PAPER_EQ4)),
    ),
    EffectCase(
        "slid",
        "a ball pressed in, then carried 0.2 mm along x with friction 0.5",
        _rough(replace(_BALL, target=_DEEPER, motion=Motion(shift_m=(0.2e-3, 0.0)))),
    ),
    EffectCase(
        "tilted",
        "a punch tilted by 1 degree: no symmetry",
        replace(_PUNCH, target=_DEEPER, motion=Motion(tilt_rad=(0.0, math.radians(1.0)))),
    ),
)
