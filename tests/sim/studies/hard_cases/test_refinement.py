"""Case 17, first half."""

from __future__ import annotations

from sim.studies.hard_cases.meshes import patch_test, rigid_motion


def test_rigid_motion_and_patch_are_exact() -> None:
    """Case 17, first half."""
    assert all(float(deviation) <= 1e-10 for deviation in rigid_motion().values())
    assert all(float(deviation) <= 1e-10 for deviation in patch_test().values())
