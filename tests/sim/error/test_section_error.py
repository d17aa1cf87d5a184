"""A press at small strains on a mesh's section, and what it tells of the mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.error.measured_errors import LADDER, Setting
from sim.error.section_error import (
    AxisymmetricGel,
    Bed,
    section_depth,
    section_error,
    section_force,
)
from sim.mesh.graded_plane import Grading, triangulate_half_section
from sim.press import press
from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target

_BALL = Scene(
    pad=DiscPad(radius_m=9e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=Sphere(diameter_m=8e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.FAST,
)
_PUNCH = replace(_BALL, indenter=Cylinder(diameter_m=5e-3, fillet_m=0.25e-3))
_EVEN = Grading(start_m=0.0, end_m=3e-3, size_m=0.5e-3)


@given(young=st.floats(1e4, 1e7), poisson=st.floats(0.0, 0.49), depth=st.floats(1e-6, 1e-4))
@settings(max_examples=20, deadline=None)
def test_a_plate_squeezes_a_disc_that_may_not_bulge(
    young: float, poisson: float, depth: float
) -> None:
    """Clamped on a wide base, its middle obeys the oedometer's modulus; F_z goes with the depth."""
    height, radius = 1e-3, 30e-3
    section = triangulate_half_section(radius, height, replace(_EVEN, end_m=radius))
    gel = AxisymmetricGel(section, height_m=height, young_pa=young, poisson=poisson, reach_m=radius)
    bed = Bed(indenter=Plane(), stiffness_pa_m=1e3 * young / height)
    modulus = young * (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    springs = 1.0 / (1.0 / bed.stiffness_pa_m + height / modulus)
    force = gel.force(bed, depth_m=depth)
    assert 0.75 * springs * depth < force / (np.pi * radius**2) <= 1.001 * springs * depth
    assert gel.force(bed, depth_m=2.0 * depth) == pytest.approx(2.0 * force, rel=1e-9)


@pytest.mark.parametrize("scene", [_BALL, _PUNCH], ids=["ball", "punch"])
def test_a_shallow_press_is_one_at_small_strains(scene: Scene) -> None:
    """At 2.5 % of the pad the section's limit is the real force within 4 %, mesh error included."""
    found = press(Setting(Preset.FAST, 1.4).applied(scene)).force_n[2]
    assert section_force(scene, depth_m=0.1e-3) == pytest.approx(found, rel=0.04)


@pytest.mark.parametrize("scene", [_BALL, _PUNCH], ids=["ball", "punch"])
def test_finer_sections_err_less(scene: Scene) -> None:
    """From the coarsest of the ladder to the finest by far, and never far below zero."""
    errors = [section_error(each.applied(scene), depth_m=0.1e-3) for each in LADDER]
    assert errors[0] > 0.03
    assert abs(errors[-1]) < 3e-3
    assert min(errors) > -5e-3
    assert errors[0] > errors[3] > errors[6] > 0.0


def test_the_gel_may_be_of_any_stiffness() -> None:
    """An error is relative, and a force in proportion."""
    soft = replace(_PUNCH, material=replace(_PUNCH.material, young_pa=1e3))
    assert section_error(soft, depth_m=1e-4) == section_error(_PUNCH, depth_m=1e-4)
    ratio = section_force(_PUNCH, depth_m=1e-4) / section_force(soft, depth_m=1e-4)
    assert ratio == pytest.approx(400.0)


@pytest.mark.parametrize("scene", [_BALL, _PUNCH], ids=["ball", "punch"])
def test_what_the_section_says_is_what_the_mesh_does(scene: Scene) -> None:
    """A coarse mesh's press, against a fine one's: off by what its section is off by, nearly."""
    deeper = replace(scene, target=Target(depth_m=0.3e-3))
    coarse, fine = (Setting(Preset.FAST, each).applied(deeper) for each in (0.75, 1.8))
    apart = press(coarse).force_n[2] / press(fine).force_n[2] - 1.0
    own, other = (section_error(each, depth_m=0.3e-3) for each in (coarse, fine))
    assert own - other == pytest.approx(apart, rel=0.35)


def test_the_depth_of_a_force() -> None:
    """Within 5 % of where the press itself ends; a depth that is given is the depth."""
    forced = replace(_BALL, target=Target(force_n=0.3))
    assert section_depth(_BALL) == _BALL.target.depth_m
    assert section_depth(forced) == pytest.approx(press(forced).depth_m, rel=0.05)
