"""The quick hard cases: what they measure meets their criteria."""

from __future__ import annotations

import numpy as np

from sim.hard_cases.consistency import patch_test, rigid_motion
from sim.hard_cases.presses import no_contact, repeatable
from sim.hard_cases.starts import random_start


def test_no_contact_is_exactly_nothing() -> None:
    """Case 14."""
    outcome = no_contact()
    assert outcome.passed
    assert outcome.measured["force_max_n"] == 0.0
    assert outcome.measured["iterations_before_touch"] == 0


def test_random_starts_end_stationary() -> None:
    """Case 2: the energy never rises, and where it ends is said."""
    outcome = random_start()
    assert outcome.passed
    measured = outcome.measured
    assert float(measured["energy_rise_max_over_first"]) <= 0.0
    ended = int(measured["ended_at_rest"]) + int(measured["ended_knotted_but_stationary"])
    assert ended == measured["starts"]
    assert np.isfinite(float(measured["det_F_min_at_the_end"]))


def test_rigid_motion_and_patch_are_exact() -> None:
    """Case 17, first half."""
    assert all(float(deviation) <= 1e-10 for deviation in rigid_motion().values())
    assert all(float(deviation) <= 1e-10 for deviation in patch_test().values())


def test_the_same_press_gives_the_same_bits() -> None:
    """Case 19, within this process and against another."""
    outcome = repeatable()
    assert outcome.passed
    assert outcome.measured["bitwise_same_process"] is True
