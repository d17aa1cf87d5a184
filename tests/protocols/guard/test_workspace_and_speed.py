"""Where the tip may be and how the tool may point."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.place_and_motion import LEAST_TRAVEL_M, FollowGuard, Workspace
from tacauchy_rig.core.errors import SafetyError
from tacauchy_rig.core.run import Pose
from tests.protocols.conftest import arm_state, breach

DOWN = (0.0, math.pi, 0.0)


def state(position, rotation=DOWN, speed=0.0):
    """Return a state of the arm, its tool straight down."""
    return arm_state(position, rotation=rotation, speed=speed)


@pytest.mark.parametrize(
    ("position", "limit"),
    [
        ((0.051, -0.4, 0.22), "workspace.x_max"),
        ((-0.051, -0.4, 0.22), "workspace.x_min"),
        ((0.0, -0.451, 0.22), "workspace.y_min"),
        ((0.0, -0.349, 0.22), "workspace.y_max"),
        ((0.0, -0.4, 0.1959), "workspace.z_min"),
        ((0.0, -0.4, 0.3001), "workspace.z_max"),
    ],
)
def test_the_box_has_six_sides(config, position, limit):
    """Each side refuses a target and faults a position beyond it."""
    workspace = Workspace(config)
    with pytest.raises(BreachError) as target:
        workspace.check_target(Pose(position=position, rotation_vector=DOWN))
    with pytest.raises(BreachError) as actual:
        workspace.check_state(state(position))
    assert target.value.limit == actual.value.limit == limit


def test_a_tilted_tool_is_refused(config):
    """2 degrees pass, 4 do not; turning about the tool's own axis is no tilt."""
    workspace = Workspace(config)
    inside = (0.0, -0.4, 0.22)
    workspace.check_state(state(inside, (0.0, math.pi - math.radians(2), 0.0)))
    workspace.check_state(state(inside, (math.pi, 0.0, 0.0)))
    with pytest.raises(BreachError, match=r"tilted by 4\.0 deg"):
        workspace.check_state(state(inside, (0.0, math.pi - math.radians(4), 0.0)))


def test_an_arm_faster_than_it_was_told_is_a_fault(config):
    """Speeds well above the highest configured one are a breach."""
    workspace = Workspace(config)
    workspace.check_state(state((0.0, -0.4, 0.22), speed=-0.010))
    with breach("robot.speed"):
        workspace.check_state(state((0.0, -0.4, 0.22), speed=-0.030))


def test_a_start_far_from_home_is_refused(config):
    """60 mm from home is too far, and the message says where home is."""
    with pytest.raises(SafetyError, match="60 mm from home") as caught:
        Workspace(config).check_start(Pose(position=(0.0, -0.4, 0.29), rotation_vector=DOWN))
    assert "0.00, -400.00, 230.00 mm" in caught.value.remedy


@given(x=st.floats(-0.2, 0.2), y=st.floats(-0.6, -0.2), z=st.floats(0.0, 0.5), tilt=st.floats(0, 1))
def test_nothing_outside_the_box_is_allowed(config, x, y, z, tilt):
    """A target that is allowed lies in the box and is not tilted."""
    box = config.workspace
    pose = Pose(position=(x, y, z), rotation_vector=(0.0, math.pi - tilt, 0.0))
    try:
        Workspace(config).check_target(pose)
    except BreachError:
        return
    assert box.x_min <= x <= box.x_max
    assert box.y_min <= y <= box.y_max
    assert box.z_min <= z <= box.z_max
    assert tilt <= box.max_tilt + 1e-9


TURN_NS = 5_000_000
WINDOW_S = 0.7


def new_guard():
    """Return a guard with the default window."""
    return FollowGuard(window_s=WINDOW_S)


def drive(guard, speed, *, follows, seconds, late_s=0.0, until_s=math.inf, begin_s=0.0, z=0.0):
    """Tell a speed again and again; from ``late_s`` on the arm goes ``follows`` times as fast.

    Returns:
        How far the arm went [m].
    """
    for turn in range(round(seconds * 1e9 / TURN_NS)):
        guard.command(speed)
        guard.check(z, now_ns=round(begin_s * 1e9) + turn * TURN_NS)
        if late_s <= turn * TURN_NS * 1e-9 < until_s:
            z += follows * speed * TURN_NS * 1e-9
    return z


@pytest.mark.parametrize(
    ("speed", "follows", "told"),
    [
        (-0.0005, 0.0, r"0.35\d mm down in 0.7 s, measured 0.000 mm"),
        (-0.0003, 0.0, r"0.21\d mm down in 0.7 s, measured 0.000 mm"),
        (0.0003, 0.0, r"0.21\d mm up in 0.7 s, measured 0.000 mm"),
        (-0.00002, 0.0, r"0.050 mm down in 2.5 s, measured 0.000 mm"),
        (-0.0003, -1.0, r"measured -0.21\d mm"),
    ],
)
def test_an_arm_that_stands_still_or_goes_the_other_way_is_noticed(speed, follows, told):
    """At any speed: after the window, or after 0.05 mm of commanded travel if that comes later."""
    with pytest.raises(BreachError, match=told) as caught:
        drive(new_guard(), speed, follows=follows, seconds=3.0)
    assert caught.value.reaction is Reaction.HOLD
    assert "pendant" in caught.value.remedy


def test_an_arm_that_stalls_on_the_way_is_noticed():
    """What it has covered before it stalled is no credit for longer than the window."""
    with pytest.raises(BreachError, match=r"measured 0.0[0-5]\d mm"):
        drive(new_guard(), -0.0003, follows=1.0, seconds=2.0 + WINDOW_S, until_s=2.0)


@given(
    speed=st.floats(-0.001, 0.001).filter(lambda v: abs(v) > 1e-7),
    follows=st.floats(0.5, 1.2),
    late_s=st.floats(0.0, 0.3),
)
@example(speed=-0.0003, follows=1.0, late_s=0.3)
@example(speed=-0.00005, follows=0.5, late_s=0.3)
def test_an_arm_that_follows_late_or_slowly_is_let_go_on(speed, follows, late_s):
    """Half as fast from 0.3 s on still counts as following; once it stands still, it is noticed."""
    guard = new_guard()
    gone = drive(guard, speed, follows=follows, seconds=3.0, late_s=late_s)
    assert gone == pytest.approx(follows * speed * (3.0 - late_s), rel=0.01)
    if 2.9 * abs(speed) > LEAST_TRAVEL_M:
        with pytest.raises(BreachError):
            drive(guard, speed, follows=0.0, seconds=3.0, begin_s=3.0, z=gone)


def test_a_servo_at_its_target_is_left_alone():
    """Speeds of micrometres per second and changes of direction prove nothing."""
    guard = new_guard()
    for turn in range(2000):
        guard.command(2e-5 if turn % 40 < 20 else -2e-5)
        guard.check(0.0, now_ns=turn * TURN_NS)
    # The same speed without a change of direction proves something.
    with pytest.raises(BreachError, match=r"up in 2\.5 s"):
        drive(new_guard(), 2e-5, follows=0.0, seconds=10.0)


def test_a_stop_begins_anew():
    """What was told before a stop is no debt."""
    guard = new_guard()
    turns = range(round(4 * WINDOW_S * 1e9) // TURN_NS)
    for turn in turns:
        guard.command(-0.0003)
        guard.check(0.0, now_ns=turn * TURN_NS)
        if turn % 100 == 99:
            guard.forget()
    with pytest.raises(BreachError, match=r"measured 0\.000 mm"):
        drive(new_guard(), -0.0003, follows=0.0, seconds=len(turns) * TURN_NS * 1e-9)


@pytest.mark.parametrize("speed", [-0.0005, -0.0003, 0.0005])
def test_an_arm_four_times_as_fast_as_told_is_stopped_within_a_fifth_of_a_second(speed):
    """Before it has gone half a millimetre; one that is a fifth too fast is let go on."""
    with pytest.raises(BreachError, match="moves further than commanded") as caught:
        drive(new_guard(), speed, follows=4.0, seconds=0.2)
    assert caught.value.reaction is Reaction.RETRACT
    drive(new_guard(), speed, follows=1.2, seconds=3.0)


def test_an_arm_that_slows_down_late_is_let_go_on():
    """It still goes at 1 mm/s for 80 ms after it was told 0.1 mm/s."""
    guard, z = new_guard(), 0.0
    for turn in range(200):
        guard.command(-0.001 if turn < 100 else -0.0001)
        guard.check(z, now_ns=turn * TURN_NS)
        z -= (0.001 if turn * TURN_NS < 100 * TURN_NS + 80_000_000 else 0.0001) * TURN_NS * 1e-9
