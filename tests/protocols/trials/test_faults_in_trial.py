"""Each thing that can go wrong in a trial: the arm stops, the data stay, the operator is told."""

import math

import pytest

from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Outcome
from tests.mock.world import Gel

OFF_GEL = "retracted slowly off the gel"
HOLDS = "told to stop and to hold"
LOCKED = "protective stop"
CLEAR = "stopped clear of the gel"


def bump(lab, **load):
    """Load the sensor from outside."""
    axes = ("fx", "fy", "fz", "mx", "my", "mz")
    lab.world.disturbance = tuple(load.get(axis, 0.0) for axis in axes)


def fault(lab, name):
    """Switch a device's failure on."""
    lab.world.begin(name)


CASES = [
    ("press", lambda lab: bump(lab, fz=7.0), "limits.soft_force", OFF_GEL),
    ("press", lambda lab: bump(lab, fz=12.0), "limits.hard_force", LOCKED),
    ("press", lambda lab: bump(lab, fx=3.0), "limits.lateral_force", OFF_GEL),
    ("press", lambda lab: bump(lab, my=0.2), "limits.moment", OFF_GEL),
    ("press", lambda lab: bump(lab, fz=3.2), "limits.force_rate", OFF_GEL),
    ("approach", lambda lab: bump(lab, fz=0.6), "limits.early_contact", CLEAR),
    ("tare", lambda lab: bump(lab, fz=0.6), "limits.early_contact", CLEAR),
    ("press", lambda lab: fault(lab, "force_sensor:stall"), "limits.stale_force", HOLDS),
    ("press", lambda lab: fault(lab, "force_sensor:freeze"), "limits.repeat_count", HOLDS),
    ("dwell", lambda lab: bump(lab, fz=math.nan), "force_sensor.finite", HOLDS),
    ("press", lambda lab: fault(lab, "force_sensor:unplug"), "force sensor", HOLDS),
    ("press", lambda lab: fault(lab, "force_sensor:drop"), "limits.corrupt_ratio", OFF_GEL),
    ("dwell", lambda lab: bump(lab, fx=50.0), "force_sensor.capacity", HOLDS),
    ("dwell", lambda lab: fault(lab, "camera:stall"), "limits.stale_image", OFF_GEL),
    ("press", lambda lab: fault(lab, "camera:unplug"), "camera", OFF_GEL),
    ("press", lambda lab: fault(lab, "robot:freeze"), "robot", HOLDS),
    ("press", lambda lab: fault(lab, "robot:stall"), "limits.no_motion", HOLDS),
    ("search", lambda lab: fault(lab, "robot:stall"), "limits.no_motion", HOLDS),
    ("retract", lambda lab: fault(lab, "robot:stall"), "robot.arrival", HOLDS),
    ("search", lambda lab: lab.bench.arm.protective_stop(), "robot", HOLDS),
    ("dwell", lambda lab: setattr(lab.sink, "trouble", "recorder: gone"), "recorder", OFF_GEL),
    ("home", lambda lab: setattr(lab.bench.arm, "refuses_poses", True), "robot", HOLDS),
    ("home", lambda lab: setattr(lab.bench.arm, "ignores_moves", True), "robot.arrival", HOLDS),
]


@pytest.mark.parametrize(
    ("phase", "go_wrong", "limit", "end"), CASES, ids=[f"{case[2]}-{case[0]}" for case in CASES]
)
def test_a_fault_stops_the_arm_and_keeps_the_data(laboratory, phase, go_wrong, limit, end):
    """Whatever fails: the limit is named, the arm rests, the attempt's record is kept."""
    lab = laboratory('protocol.force_targets=["2 N", "3 N"]')
    lab.when_phase(phase, lambda: go_wrong(lab), delay_s=0.3)
    result = lab.run()
    assert result.outcome is Outcome.FAULT
    fault_event = next(event for event in lab.sink.events if event.name == "fault")
    assert fault_event.detail["limit"] == limit
    assert fault_event.detail["during"] in {phase, "approach"}
    assert end in result.reason
    assert result.remedy
    record = lab.sink.records[-1]
    assert (record.index, record.outcome) == (1, Outcome.FAULT)
    assert record.reason.startswith(fault_event.detail["reason"])
    lab.assert_rests()
    if end is OFF_GEL:
        assert lab.world.force_n == 0.0
    if end is HOLDS:
        height_m = lab.world.pose.position[2]
        assert height_m <= fault_event.detail["position_m"][2] + 1e-4


def test_a_fault_names_the_trials_that_are_safe(laboratory):
    """After a fault in trial 3 the operator reads that trials 1 and 2 are safe, and where it is."""
    lab = laboratory('protocol.force_targets=["1 N", "1.5 N", "2 N"]')

    def third_press():
        return [e.trial for e in lab.sink.events if e.detail.get("phase") == "press"][-1:] == [3]

    lab.world.when(third_press, lambda: bump(lab, fz=7.0))
    result = lab.run()
    assert "Trials 1 to 2 are safe." in result.reason
    assert "mm" in result.reason
    assert [record.outcome for record in result.records] == [
        Outcome.PASSED,
        Outcome.PASSED,
        Outcome.FAULT,
    ]


@pytest.mark.parametrize("press_speed", ["0.02 mm/s", "0.3 mm/s", "0.5 mm/s"])
def test_an_arm_that_begins_late_is_not_called_stalled(laboratory, press_speed):
    """A CB3 controller that answers each command 0.1 s late, at any press speed."""
    lab = laboratory(
        'protocol.force_targets=["0.5 N"]',
        f'robot.press_speed="{press_speed}"',
        'robot.model="cb3"',
        motion_delay_s=0.1,
    )
    result = lab.run()
    assert result.outcome is Outcome.PASSED, result.reason


def test_an_overexposed_image_is_a_criterion_that_is_missed(laboratory):
    """The press goes on, but nobody takes white images for a result."""
    lab = laboratory('protocol.force_targets=["1 N"]', "protocol.attempts=1")
    lab.when_phase("dwell", lambda: fault(lab, "camera:saturate"), delay_s=0.3)
    result = lab.run()
    assert result.outcome is Outcome.FAILED
    missed = [criterion for criterion in result.records[0].criteria if not criterion.passed]
    assert [(c.name, c.measured, c.limit) for c in missed] == [
        ("image_clipped_ratio", 1.0, "<= 0.25")
    ]
    assert "camera.exposure" in missed[0].remedy


def test_a_gel_that_is_too_soft_ends_at_the_depth_limit(laboratory):
    """5 N at 1 N/mm would need 5 mm: the depth limit stops the press at 2 mm."""
    lab = laboratory('protocol.force_targets=["5 N"]', gel=Gel(stiffness_n_m=1000.0))
    result = lab.run()
    assert result.reason.startswith("limits.max_depth 2 mm")
    assert lab.world.force_n == 0.0


def test_a_fault_before_the_first_trial_leaves_no_attempt(laboratory):
    """Something touched in the air press: no attempt was begun."""
    lab = laboratory()
    lab.when_phase("air-press", lambda: bump(lab, fz=1.0), delay_s=1.0)
    result = lab.run()
    assert result.outcome is Outcome.FAULT
    assert lab.sink.begun == []
    assert "during air-press" in result.reason
    assert "No trial has passed yet." in result.reason


def test_starting_away_from_home_moves_nothing(laboratory):
    """The programme refuses before the first motion."""
    lab = laboratory()
    lab.world.pose = lab.world.pose.shifted(x=0.02, z=0.055)
    result = lab.run()
    assert "from home" in result.reason
    assert lab.bench.arm.fastest_m_s == 0.0


@pytest.mark.parametrize(
    ("second", "delay_s", "told"),
    [("camera:stall", 0.4, OFF_GEL), ("force_sensor:stall", 1.0, "the retract ended early")],
)
def test_a_retract_ends_where_force_is_gone_and_not_where_images_are(
    laboratory, second, delay_s, told
):
    """A lesser failure must not leave the indenter in the gel; without force the arm holds."""
    lab = laboratory('protocol.force_targets=["4 N"]')
    lab.when_phase("dwell", lambda: bump(lab, fz=3.0), delay_s=0.3)
    lab.when_phase("dwell", lambda: fault(lab, second), delay_s=delay_s)
    result = lab.run()
    assert told in result.reason
    lab.assert_rests()
    if told is OFF_GEL:
        assert lab.world.force_n == 0.0


def test_a_lesser_fault_while_stopping_does_not_hide_a_worse_one(laboratory):
    """The hard limit is passed while the arm comes to rest, then the sensor is gone: locked."""
    lab = laboratory('protocol.force_targets=["4 N"]')
    lab.when_phase("dwell", lambda: bump(lab, fz=3.0), delay_s=0.3)
    lab.when_phase("dwell", lambda: bump(lab, fz=12.0), delay_s=0.4)
    lab.when_phase("dwell", lambda: fault(lab, "force_sensor:unplug"), delay_s=0.5)
    assert LOCKED in lab.run().reason
    with pytest.raises(DeviceError, match="protective stop"):
        lab.bench.arm.state()
