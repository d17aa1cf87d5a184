"""An arm that does not do what it was told is noticed, and no other."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.breach import BreachError, Reaction
from protocols.follow_guard import WINDOW_NS, FollowGuard

TURN_NS = 5_000_000


def drive(guard, speed, *, follows, seconds, late_s=0.0):
    """Tell a speed again and again; the arm goes ``follows`` times as fast, ``late_s`` later."""
    z = 0.0
    for turn in range(round(seconds * 1e9 / TURN_NS)):
        guard.tell(speed)
        guard.check(z, now_ns=turn * TURN_NS)
        if turn * TURN_NS * 1e-9 >= late_s:
            z += follows * speed * TURN_NS * 1e-9


@pytest.mark.parametrize("speed", [-0.0005, -0.0003, -0.0001, 0.0005])
def test_an_arm_that_stands_still_is_noticed(speed):
    """In the search and in the press, after the window."""
    with pytest.raises(BreachError, match="does not follow") as caught:
        drive(FollowGuard(), speed, follows=0.0, seconds=1.0)
    assert caught.value.reaction is Reaction.HOLD


def test_an_arm_that_goes_the_other_way_is_noticed():
    """Distance alone is not enough."""
    with pytest.raises(BreachError, match="does not follow"):
        drive(FollowGuard(), -0.0003, follows=-1.0, seconds=1.0)


@given(
    speed=st.floats(-0.001, 0.001).filter(lambda v: abs(v) > 1e-7),
    follows=st.floats(0.5, 1.2),
    late_s=st.floats(0.0, 0.3),
)
def test_an_arm_that_follows_late_or_slowly_is_let_go_on(speed, follows, late_s):
    """Half as fast from 0.3 s on still counts as following."""
    drive(FollowGuard(), speed, follows=follows, seconds=3.0, late_s=late_s)


def test_a_servo_at_its_target_is_left_alone():
    """Speeds of micrometres per second and changes of direction prove nothing."""
    guard = FollowGuard()
    for turn in range(2000):
        guard.tell(2e-5 if turn % 40 < 20 else -2e-5)
        guard.check(0.0, now_ns=turn * TURN_NS)


def test_a_stop_begins_anew():
    """What was told before a stop is no debt."""
    guard = FollowGuard()
    for turn in range(4 * WINDOW_NS // TURN_NS):
        guard.tell(-0.0003)
        guard.check(0.0, now_ns=turn * TURN_NS)
        if turn % 100 == 99:
            guard.forget()
