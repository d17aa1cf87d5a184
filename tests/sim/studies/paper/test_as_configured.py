"""The paper's model as it states it, set up and pressed."""

import pytest

from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.studies.paper.presses import (
    AS_CONFIGURED,
    THIN,
    every_press,
    pressed,
    rest_stress_pa,
    scenes,
)


def test_models_differ_in_mesh_and_barrier_alone() -> None:
    """Mu 0.5 for all; d_hat of 1 mm for the paper's, ours beside it on the same mesh."""
    found = scenes()
    paper, thin = found[AS_CONFIGURED], found[THIN]
    assert {scene.friction for scene in found.values()} == {0.5}
    assert (paper.preset, thin.preset) == (Preset.PAPER, Preset.PAPER)
    assert paper.contact_distance_m == pytest.approx(1e-3)
    assert thin.contact_distance_m < 1e-4


def test_the_wide_barrier_holds_the_punch_off_the_gel() -> None:
    """Nearly all of d_hat is left at a newton; the force is met within the paper's tolerance."""
    found = pressed(AS_CONFIGURED, forces_n=(1.0, 2.0))
    first, second = found["at_forces"]
    assert first["gap_m"] > 0.8e-3
    assert first["off_n"] < 0.08
    assert second["depth_m"] > first["depth_m"]
    assert every_press(found) == [found["at_depth"], first, second]


def test_only_the_printed_law_is_not_stress_free_at_rest() -> None:
    """It leaves mu, the shear modulus."""
    scene = scenes()[THIN]
    shear = 0.5 * scene.material.young_pa / (1.0 + scene.material.poisson)
    assert rest_stress_pa(LawName.PAPER_EQ4) == pytest.approx(shear, rel=1e-6)
    assert abs(rest_stress_pa(LawName.STABLE_NEO_HOOKEAN)) < 1e-6 * shear
