"""Pressing, sliding and torsion with friction, by their signatures."""

from __future__ import annotations

import numpy as np
import pytest

from sim.contact_modes import contact_signature
from sim.effects import plan_effects
from sim.indenter import Sphere
from sim.loading import Hold, LoadingPath
from sim.pad import DiscPad
from sim.press import path_for
from sim.scene import ContactMode, Material, Motion, Preset, Scene, Target

MU = 0.5


@pytest.fixture
def pressed() -> LoadingPath:
    """A ball pressed into a small whole pad, with friction."""
    scene = Scene(
        pad=DiscPad(radius_m=8e-3, height_m=4e-3),
        material=Material(young_pa=4e5, poisson=0.48),
        indenter=Sphere(diameter_m=10e-3),
        target=Target(depth_m=0.3e-3),
        preset=Preset.FAST,
        contact=ContactMode.FRICTION,
        friction=MU,
        motion=Motion(shift_m=(1e-3, 0.0)),
    )
    path = path_for(scene, plan_effects(scene))
    path.advance(0.3e-3)
    return path


def test_pressing_pulls_radially_and_sums_to_nothing(pressed: LoadingPath) -> None:
    """Tangential forces of a straight press cancel."""
    assert pressed.last is not None
    signature = contact_signature(pressed.last)
    assert signature.radial_share > 0.85
    assert np.linalg.norm(signature.tangential_n[:2]) < 1e-3 * signature.normal_n


def test_sliding_opposes_the_motion_with_mu_times_the_normal_force(pressed: LoadingPath) -> None:
    """Under a held force, along x: the resultant, and the pressure that moves forward."""
    assert pressed.last is not None
    before = pressed.last.force_n[2]
    point = pressed.carry(shift_m=(0.4e-3, 0.0), hold=Hold.FORCE)
    signature = contact_signature(point)
    on_indenter = -np.array(signature.tangential_n)
    assert on_indenter[0] / np.linalg.norm(on_indenter[:2]) < -0.98
    assert signature.mobilised_friction == pytest.approx(MU, rel=0.03)
    assert signature.tangential_sum_n <= MU * signature.normal_n * (1.0 + 1e-3)
    assert signature.centre_m[0] > 1e-5
    assert point.force_n[2] == pytest.approx(before, rel=1e-6)


def test_torsion_pulls_around_the_axis(pressed: LoadingPath) -> None:
    """A third of a radian is enough for the contact to slip round."""
    point = pressed.carry(twist_rad=0.35)
    signature = contact_signature(point)
    assert signature.circumferential_share >= 0.95
    assert np.linalg.norm(point.force_n[:2]) < 1e-6 * point.force_n[2]


def test_a_load_is_met_and_gives_the_same_depth() -> None:
    """Driven by load to another point's force, the indenter comes to that point's depth."""
    frictionless = Scene(
        pad=DiscPad(radius_m=8e-3, height_m=4e-3),
        material=Material(young_pa=4e5, poisson=0.48),
        indenter=Sphere(diameter_m=10e-3),
        target=Target(depth_m=0.2e-3),
        preset=Preset.FAST,
    )
    plan = plan_effects(frictionless)
    by_depth = path_for(frictionless, plan).advance(0.2e-3)
    by_load = path_for(frictionless, plan).push(float(by_depth.force_n[2]))
    assert by_load.force_n[2] == pytest.approx(by_depth.force_n[2], rel=1e-7)
    assert by_load.depth_m == pytest.approx(by_depth.depth_m, rel=1e-6)
