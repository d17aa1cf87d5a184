"""Where the tip may be and how the tool may point."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.guard.breach import BreachError
from protocols.guard.workspace import Workspace
from tacauchy_rig.core.errors import SafetyError
from tacauchy_rig.core.run import ArmSample, Pose

DOWN = (0.0, math.pi, 0.0)


def state(position, rotation=DOWN, speed=0.0):
    """Return a state of the arm."""
    return ArmSample(
        stamp_ns=0,
        controller_time_s=0.0,
        pose=Pose(position=position, rotation_vector=rotation),
        velocity=(0.0, 0.0, speed, 0.0, 0.0, 0.0),
        runtime_state=2,
        safety_bits=1,
        robot_mode=7,
    )


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
    with pytest.raises(BreachError) as caught:
        workspace.check_state(state((0.0, -0.4, 0.22), speed=-0.030))
    assert caught.value.limit == "robot.speed"


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
