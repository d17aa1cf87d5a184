"""The estimate of a force error from coarser meshes."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.force_error_estimate import (
    COARSENINGS,
    CoarserForce,
    error_order,
    estimate_force_error,
    estimate_from,
    richardson_error,
    with_estimate,
)
from sim.press import press
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target

SCENE = Scene(
    pad=DiscPad(radius_m=5e-3, height_m=3e-3),
    material=Material(young_pa=3e5, poisson=0.46),
    indenter=Sphere(diameter_m=5e-3),
    target=Target(depth_m=0.15e-3),
    preset=Preset.FAST,
)


@given(
    order=st.floats(0.5, 4.0),
    limit=st.floats(0.1, 10.0),
    share=st.floats(-0.25, 0.25, allow_subnormal=False),
)
def test_exact_power_law_gives_its_error(order: float, limit: float, share: float) -> None:
    """Forces limit (1 + share h^p) have the relative error |share| / (1 + share) at h = 1."""
    forces = [
        CoarserForce(ratio=ratio, force_n=limit * (1.0 + share * ratio**order))
        for ratio in COARSENINGS
    ]
    fine = limit * (1.0 + share)
    found = richardson_error(fine, forces, order=order)
    assert found == pytest.approx(abs(share) / (1.0 + share), rel=1e-6, abs=1e-12)


def test_largest_estimate_counts() -> None:
    """A mesh that happens to agree does not hide another that does not."""
    forces = [CoarserForce(ratio=1.5, force_n=1.0), CoarserForce(ratio=2.0, force_n=1.1)]
    assert richardson_error(1.0, forces, order=1.0) == pytest.approx(0.1)


def test_sharp_rims_converge_more_slowly() -> None:
    """The order follows from what is pressed in."""
    assert error_order(SCENE) == 2.0
    assert error_order(replace(SCENE, indenter=Cylinder(diameter_m=3e-3))) == 1.0


def test_estimate_says_what_it_rests_on() -> None:
    """The basis names the forces and the factor; effects left out are added."""
    forces = [CoarserForce(ratio=1.5, force_n=1.02), CoarserForce(ratio=2.0, force_n=1.05)]
    with_all, without = (estimate_from(SCENE, 1.0, forces, left_out=e) for e in (0.0, 0.01))
    assert with_all.relative is not None
    assert without.relative == pytest.approx(with_all.relative + 0.01)
    assert "1.0200 N on 1.5 h" in without.basis
    assert "effects left out" in without.basis


def test_no_force_has_no_error() -> None:
    """An indenter in the air is told so, and nothing is pressed."""
    found = estimate_force_error(SCENE, depth_m=0.0, force_n=0.0)
    assert found.relative is None
    assert "no force" in found.basis


def test_a_press_gets_an_estimate() -> None:
    """A ball to a load: two coarser presses at its depth, the error a few per cent of the force."""
    scene = replace(SCENE, target=Target(force_n=0.05))
    bare = press(scene)
    result = with_estimate(scene, bare)
    assert result.force_n == bare.force_n
    assert result.estimated_force_error_relative is not None
    assert 1e-3 < result.estimated_force_error_relative < 0.3
    assert result.estimated_force_error_basis.startswith("Richardson")
    assert "estimate" in result.as_json()["wall_s"]
