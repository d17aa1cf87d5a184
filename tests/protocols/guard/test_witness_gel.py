"""The band of a press: what it must let pass, and what it must not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from protocols.guard.witness import CREEP_SHARE, DEEPEST_SHARE, PressBand
from tacauchy_rig.core.expected_press import ExpectedPress

STIFFNESS_N_M = 6000.0
CONTACT_N = 0.05
SPRING = ExpectedPress(
    sensor="a spring",
    made="by hand",
    depth_m=(0.0, 2e-3),
    force_n=(0.0, 12.0),
    low=0.7,
    high=1.25,
    lean_m=0.0,
    depth_error_m=20e-6,
    gel_height_m=4e-3,
)


def band(**changed):
    """Return the band of a spring, changed."""
    return PressBand(replace(SPRING, **changed), contact_force_n=CONTACT_N)


def test_a_spring_gives_the_factors_times_its_stiffness():
    """By hand: 0.3 mm less or more 20 um of depth error, creep either way."""
    least_n, most_n = band().bounds([(0.0, CONTACT_N)], 3e-4)
    kept = 1.0 - CREEP_SHARE
    assert least_n == pytest.approx(kept * (CONTACT_N + 0.7 * STIFFNESS_N_M * 2.8e-4))
    assert most_n == pytest.approx(CONTACT_N + 1.1 * 1.25 * STIFFNESS_N_M * 3.2e-4)


def test_points_on_the_way_narrow_the_band():
    """What was felt at 0.2 mm decides more at 0.3 mm than the contact does."""
    alone = band().bounds([(0.0, CONTACT_N)], 3e-4)
    after = band().bounds([(0.0, CONTACT_N), (2e-4, 1.25)], 3e-4)
    assert after[0] > alone[0]
    assert after[1] < alone[1]
    assert after[0] < 1.25 + 0.6 < after[1]


def test_a_leaning_face_gives_its_straight_force_less_its_lean():
    """Fully in contact it is a straight one that begins at the lean; half in contact it is less."""
    leaning = band(lean_m=1e-4, depth_error_m=0.0)
    full_n, _ = leaning.bounds([(0.0, 0.0)], 5e-4)
    assert full_n == pytest.approx(0.9 * 0.7 * STIFFNESS_N_M * 4e-4, rel=1e-3)
    half_n, _ = leaning.bounds([(0.0, 0.0)], 1e-4)
    # A disc's first moment of its half about the middle: 2 R / (3 pi) of its area.
    share = 2.0 / (3.0 * np.pi)
    assert half_n == pytest.approx(0.9 * 0.7 * STIFFNESS_N_M * 1e-4 * share, rel=0.02)


def test_a_target_bounds_its_depth():
    """Force over the softest stiffness, and never beyond half of the gel."""
    bound_m = band().depth_bound(2.0)
    assert bound_m == pytest.approx(2.0 / (0.9 * 0.7 * STIFFNESS_N_M) + 20e-6, rel=1e-3)
    assert band().depth_bound(100.0) == DEEPEST_SHARE * 4e-3


def test_no_depth_has_an_empty_band():
    """At any depth the stated gel itself lies between the bounds."""
    for depth_m in np.linspace(0.0, 2.5e-3, 50):
        least_n, most_n = band(lean_m=8e-5).bounds([(0.0, CONTACT_N)], float(depth_m))
        assert least_n <= CONTACT_N + STIFFNESS_N_M * depth_m <= most_n
