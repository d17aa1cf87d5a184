"""The force servo against springs it does not know."""

import random
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.faults import parse_fault
from protocols.guard.breach_reaction import BreachError
from protocols.guard.force_limits import Contact
from protocols.guard.place_and_motion import BEYOND_M
from protocols.steps.arm_moves import approach, search_contact
from protocols.steps.force_servo_hold_sway import ForceServo
from protocols.steps.tare_and_force_window import take_tare
from tests.mock.world import Gel
from tests.protocols.conftest import NEAR, breach

PERIOD_S = 0.01
CAP_M_S = 0.0003


def hold(stiffness, target_n, *, delay_s, noise_n=0.0, duration_s=25.0):
    """Return forces of a servo that holds ``target_n`` on a relaxing gel."""
    gel = Gel(stiffness_n_m=stiffness)
    source = random.Random(3)  # noqa: S311 - noise, not a secret
    servo = ForceServo(
        target_n=target_n, speed_cap=CAP_M_S, period_s=PERIOD_S, contact_force_n=0.05
    )
    late = deque([0.0] * max(1, round(delay_s / PERIOD_S)))
    contact_m = 0.05 / stiffness
    depth_m = contact_m
    forces = []
    for _ in range(round(duration_s / PERIOD_S)):
        force_n = gel.press(depth_m, duration_s=PERIOD_S)
        forces.append(force_n)
        felt_n = force_n + source.gauss(0.0, noise_n)
        late.append(servo.update(felt_n, depth_m=depth_m - contact_m))
        speed = late.popleft()
        assert abs(speed) <= CAP_M_S
        depth_m += speed * PERIOD_S
    return forces


@settings(max_examples=30, deadline=None)
@given(
    stiffness=st.floats(1_000, 15_000), target_n=st.floats(1.0, 5.0), delay_s=st.floats(0.0, 0.1)
)
def test_any_gel_is_held_without_overshoot(stiffness, target_n, delay_s):
    """Whatever the stiffness and the delay, force stays below target + 0.03 N and arrives."""
    forces = hold(stiffness, target_n, delay_s=delay_s)
    assert max(forces) < target_n + 0.03
    dwell = forces[-100:]
    assert abs(sum(dwell) / len(dwell) - target_n) < 0.01


def test_noise_does_not_shake_the_arm():
    """With 0.01 N of noise the true force stays within 0.02 N of the target."""
    forces = hold(4000.0, 3.0, delay_s=0.05, noise_n=0.01)
    assert max(abs(force - 3.0) for force in forces[-500:]) < 0.02


def test_it_sways_for_as_long_as_asked_between_dwell_and_retract(laboratory):
    """Up from where the force was held, by some 0.05 mm, and no faster than press_speed."""
    lab = laboratory('protocol.force_targets=["2 N"]', 'protocol.sway="4 s"', ways=())
    [record] = lab.run().records
    assert record.passed
    assert lab.phases[-5:] == ["dwell", "sway", "retract", "drift-check", "verdict"]
    stamps = {e.detail["phase"]: e.stamp_ns for e in lab.sink.events if e.name == "phase"}
    states = [s for s in lab.sink.states if stamps["sway"] <= s.stamp_ns <= stamps["retract"]]
    assert 3.9e9 < states[-1].stamp_ns - states[0].stamp_ns < 4.2e9
    depth_m = record.contact_z_m - np.array([state.pose.position[2] for state in states])
    assert depth_m.max() < record.depth_measured_m + 5e-6
    assert 30e-6 < np.ptp(depth_m) < 90e-6
    assert max(abs(state.velocity[2]) for state in states) <= 1.01 * lab.config.robot.press_speed


def above_the_gel(laboratory, *overrides, silent_fault="", **world):
    """Return a laboratory whose arm stands above the gel, tared; the cell lies from the start."""
    short = (*NEAR, 'protocol.tare_duration="0.4 s"')
    lab = laboratory(*short, *overrides, bias=(0.0,) * 6, **world)
    if silent_fault:
        lab.world.begin(parse_fault(f"force_sensor:{silent_fault}"))
    lab.cycle.force_guard.set_zero(take_tare(lab.cycle))
    lab.cycle.force_guard.contact = Contact.NONE
    approach(lab.cycle)
    return lab


def test_the_gel_is_found_where_it_is(laboratory):
    """0.4 mm higher than the configuration says, to 30 um."""
    lab = above_the_gel(laboratory, surface_offset_m=0.4e-3)
    assert search_contact(lab.cycle) == pytest.approx(0.2004, abs=30e-6)


@pytest.mark.parametrize(
    ("silent", "told", "remedy", "most_n"),
    [
        ("sign", "compression_sign 1: the force went to -0", "compression_sign = -1", 0.3),
        ("swap-axes", "N sideways and", "axes are swapped", 0.6),
    ],
)
def test_a_force_of_wrong_sign_or_axis_ends_the_search_at_once(
    laboratory, silent, told, remedy, most_n
):
    """The setting, or another cell's decoupling matrix, is named."""
    lab = above_the_gel(laboratory, silent_fault=silent)
    with pytest.raises(BreachError, match=told) as caught:
        search_contact(lab.cycle)
    assert remedy in caught.value.remedy
    assert lab.world.force_n < most_n


def test_the_floor_is_the_lowest_place_where_the_gel_can_be(laboratory):
    """The surface is known to 0.3 mm: it is not looked for further below."""
    lab = above_the_gel(laboratory, 'sensor.surface_uncertainty="0.3 mm"', surface_offset_m=-2e-3)
    with breach("sensor.surface_uncertainty", match="nothing was touched"):
        search_contact(lab.cycle)
    assert lab.world.pose.position[2] == pytest.approx(0.2 - 0.3e-3 - BEYOND_M, abs=50e-6)


def test_a_height_that_was_found_before_is_the_floor(laboratory):
    """After a first trial the gel is known better than the configuration says."""
    lab = above_the_gel(laboratory, surface_offset_m=-0.5e-3)
    lab.cycle.contact_z_m = 0.2002
    with breach("witness.contact_height"):
        search_contact(lab.cycle)
