"""Rotation vectors turned by hand, against scipy's."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tacauchy_rig.core.rotations import composed, quaternion, rotated
from tacauchy_rig.core.run import Vector3

_angle = st.one_of(st.floats(-math.pi, math.pi), st.floats(-1e-11, 1e-11))
_vector = st.tuples(_angle, _angle, _angle)


@given(v=_vector, turn=_vector)
def test_a_vector_is_turned_as_scipy_turns_it(v: Vector3, turn: Vector3) -> None:
    """Rodrigues' formula, for turns by nothing at all too."""
    assert rotated(v, turn) == pytest.approx(Rotation.from_rotvec(turn).apply(v), abs=1e-9)


@given(a=_vector, b=_vector, v=_vector)
def test_composed_rotations_turn_one_after_the_other(a: Vector3, b: Vector3, v: Vector3) -> None:
    """Turning by a composition is turning by the second, then by the first."""
    first, second, both = (Rotation.from_rotvec(r) for r in (a, b, composed(a, b)))
    assert both.apply(v) == pytest.approx(first.apply(second.apply(v)), abs=1e-9)


@given(turn=_vector)
def test_a_quaternion_is_scipys_or_its_opposite(turn: Vector3) -> None:
    """Both are the same turn."""
    w, x, y, z = quaternion(turn)
    theirs = Rotation.from_quat([x, y, z, w])
    assert (theirs.inv() * Rotation.from_rotvec(turn)).magnitude() == pytest.approx(0.0, abs=1e-9)
