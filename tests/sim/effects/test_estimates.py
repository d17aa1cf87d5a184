"""Estimates: their scalings and limits, which need no press."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.effects import estimates
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Material, RelaxationTerm
from sim.scene.pad import BoxPad
from sim.scene.scene import Scene, Target

GEL = Material(young_pa=0.4e6, poisson=0.45)
SCENE = Scene(
    pad=BoxPad(size_x_m=20e-3, size_y_m=25e-3, height_m=4e-3),
    material=GEL,
    indenter=Cylinder(diameter_m=5e-3, fillet_m=0.2e-3),
    target=Target(depth_m=0.5e-3),
)


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
    twice = replace(SCENE, duration_s=2.0 * SCENE.duration_s)
    assert estimates.inertia_error(SCENE) == pytest.approx(4.0 * estimates.inertia_error(twice))
    assert estimates.gravity_error(SCENE) == pytest.approx(1e3 * 9.81 * 4e-3 / 0.4e6)


@pytest.mark.parametrize(("duration_s", "excess"), [(1e-6, 0.25 / 0.75), (1e6, 0.0)])
def test_relaxation_lies_between_its_limits(duration_s: float, excess: float) -> None:
    """A quick press meets the whole stiffness, a slow one the slow modulus's alone."""
    relaxing = replace(GEL, relaxation=(RelaxationTerm(share=0.25, time_s=1.0),))
    scene = replace(SCENE, material=relaxing, duration_s=duration_s)
    assert estimates.relaxation_error(scene) == pytest.approx(excess, abs=1e-5)


def test_linear_tetrahedra_lock_the_more_the_less_a_gel_gives() -> None:
    """The error rises towards nu = 1/2."""
    errors = [
        estimates.locking_error(replace(SCENE, material=replace(GEL, poisson=nu)))
        for nu in (0.3, 0.4, 0.48, 0.499)
    ]
    assert errors == sorted(errors)
    assert errors[-1] > 1.0
