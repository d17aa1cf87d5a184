"""Estimates: their scalings and limits, which need no press."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.effects import estimates
from sim.press_command import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Layer
from sim.scene.pad import BoxPad
from sim.scene.scene import Target

SCENE = scene_from(
    "--pad box:20x25x4mm --young 0.4MPa --poisson 0.45 "
    "--indenter cylinder:diameter=5mm,fillet=0.2mm --depth 0.5mm"
)
GEL = SCENE.material


@pytest.mark.parametrize(
    "indenter", [Cylinder(diameter_m=5e-3), Sphere(diameter_m=8e-3)], ids=["punch", "ball"]
)
def test_depth_and_force_are_each_others_inverse(indenter: Indenter) -> None:
    """The force expected at a depth leads back to the depth."""
    scene = replace(SCENE, indenter=indenter)
    force = estimates.expected_force(scene)
    assert force > 0.0
    back = estimates.expected_depth(replace(scene, target=Target(force_n=force)))
    assert back == pytest.approx(0.5e-3, rel=1e-9)


def test_expected_force_of_a_punch_is_the_half_spaces_on_a_thick_gel() -> None:
    """2 a E d / (1 - nu^2) where the gel is much thicker than the punch is wide."""
    thick = replace(SCENE, pad=BoxPad(size_x_m=9.0, size_y_m=9.0, height_m=5.0))
    half_space = 2.0 * 2.5e-3 * GEL.young_pa * 0.5e-3 / (1.0 - GEL.poisson**2)
    assert estimates.expected_force(thick) == pytest.approx(half_space, rel=1e-3)


def test_inertia_and_gravity_scale_as_they_must() -> None:
    """(T1 / t)^2, and rho g H / E of the softest."""
    once, twice = (
        estimates.inertia_error(replace(SCENE, duration_s=k * SCENE.duration_s)) for k in (1, 2)
    )
    assert once is not None
    assert twice == pytest.approx(0.25 * once)
    assert estimates.weight_scale(SCENE) == pytest.approx(1e3 * 9.81 * 4e-3 / 0.4e6)


def test_beyond_their_ranges_scales_say_nothing() -> None:
    """A press as quick as the pad rings, and a gel that flows."""
    quick = replace(SCENE, duration_s=2.0 * estimates.slowest_period(SCENE))
    assert estimates.inertia_error(quick) is None
    soft = replace(SCENE, material=replace(GEL, young_pa=1e3))
    assert estimates.gravity_error(soft) is None


@pytest.mark.parametrize(
    ("share", "fillet_m", "several"), [(0.3, 0.0, True), (0.2, 0.0, False), (0.3, 0.2e-3, False)]
)
def test_a_deep_sharp_rim_has_several_equilibria(
    share: float, fillet_m: float, several: bool
) -> None:
    """Its faces fold at the rim; shallow ones and rounded ones do not."""
    indenter = Cylinder(diameter_m=5e-3, fillet_m=fillet_m)
    target = Target(depth_m=share * SCENE.pad.height_m)
    scene = replace(SCENE, indenter=indenter, target=target)
    assert estimates.has_several_equilibria(scene) is several


@pytest.mark.parametrize(("skin_pa", "several"), [(0.1e6, True), (1e6, False)])
def test_a_sharp_rim_folds_a_softer_skin_sooner(skin_pa: float, several: bool) -> None:
    """A skin of a tenth of the gel is folded at an eighth of it; a stiffer one is not."""
    skin = Layer(share=0.1, material=replace(GEL, young_pa=skin_pa))
    scene = replace(
        SCENE,
        material=skin.material,
        layers=(Layer(share=0.9, material=GEL), skin),
        indenter=Cylinder(diameter_m=5e-3),
        target=Target(depth_m=0.125 * SCENE.pad.height_m),
    )
    assert estimates.has_several_equilibria(scene) is several
