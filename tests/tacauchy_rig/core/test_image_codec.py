"""Small types of the core: images, rotation vectors, alternatives."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tacauchy_rig.core.image_codec import decode_rgb, encode_png, to_grey
from tacauchy_rig.core.rotations import composed, quaternion, rotated
from tacauchy_rig.core.run import Vector3
from tacauchy_rig.core.simulated import Alternative


def test_a_png_comes_back() -> None:
    """Every pixel and the order of the channels survive; what is no image is None."""
    image = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    again = decode_rgb(encode_png(image))
    assert again is not None
    assert np.array_equal(again, image)
    assert decode_rgb(b"") is None
    assert decode_rgb(b"no image") is None


def test_grey_is_bt601() -> None:
    """Luminance weights are 0.299, 0.587, 0.114; grey stays as it is."""
    pixel = np.array([[[200, 100, 50]]], np.uint8)
    assert to_grey(pixel)[0, 0] == round(0.299 * 200 + 0.587 * 100 + 0.114 * 50)
    assert np.array_equal(to_grey(pixel[..., 0]), pixel[..., 0])


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


def test_long_times_are_whole_numbers() -> None:
    """Two digits below a hundred, none after the point from there on, never 1e+02."""
    slow = Alternative(
        role="better", setting="accurate", error_relative=0.012, time_ratio=3.14159, wall_s=123.4
    )
    text = "preset accurate: about 3.1 times the time (123 s), force error 1.2%"
    assert str(slow) == text
