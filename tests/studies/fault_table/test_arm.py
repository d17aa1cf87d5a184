"""What is read from the trace of an emulated arm."""

from __future__ import annotations

import pytest

from tests.drivers.arm_notes import TraceRow
from tests.studies.fault_table.arm import arm_after, force_rise, is_at_rest, true_forces

MS = 1_000_000
CYCLE_NS = 2 * MS
START_Z = 0.2


def trace(*legs, start_ns=0):
    """Return rows of an arm that goes through (duration [ms], velocity in z [m/s])."""
    rows, stamp_ns, z = [], start_ns, START_Z
    for duration_ms, velocity in legs:
        for _ in range(duration_ms * MS // CYCLE_NS):
            rows.append(
                TraceRow(
                    stamp_ns=stamp_ns,
                    position=(0.0, 0.0, z),
                    velocity=(0.0, 0.0, velocity),
                    runtime_state=2,
                )
            )
            stamp_ns += CYCLE_NS
            z += velocity * CYCLE_NS * 1e-9
    return rows


def test_an_arm_that_stops_and_retracts():
    """Down for 200 ms after the moment, still for 300 ms, then up: each is told apart."""
    rows = trace((500, -0.0005), (300, 0.0), (1000, 0.002), (500, 0.0))
    seen = arm_after(rows, 300 * MS, now_ns=2300 * MS)
    assert seen.stopped_after_s == pytest.approx(0.2, abs=0.002)
    assert seen.descended_m == pytest.approx(0.0001, rel=0.02)
    assert seen.raised_after_m == pytest.approx(0.002, rel=0.01)
    assert (seen.lowered_after_m, seen.at_rest) == (0.0, True)
    assert seen.speed_before_m_s == 0.0005


def test_a_short_halt_is_no_stop():
    """Standing still for 50 ms on the way down does not count."""
    rows = trace((100, -0.0005), (50, 0.0), (100, -0.0005), (200, 0.0))
    seen = arm_after(rows, 90 * MS, now_ns=450 * MS)
    assert seen.stopped_after_s == pytest.approx(0.16, abs=0.003)


def test_going_down_again_shows():
    """The worst thing that an arm could do after a fault."""
    rows = trace((100, -0.0005), (200, 0.0), (100, -0.0005), (300, 0.0))
    seen = arm_after(rows, 50 * MS, now_ns=700 * MS)
    assert seen.stopped_after_s == pytest.approx(0.05, abs=0.003)
    assert seen.lowered_after_m == pytest.approx(5e-5, rel=0.05)


def test_an_arm_that_never_stops():
    """It moves in the last row, so there is no time of stopping."""
    rows = trace((500, -0.0005))
    seen = arm_after(rows, 100 * MS, now_ns=500 * MS)
    assert (seen.stopped_after_s, seen.at_rest) == (None, False)


def test_an_arm_that_stood_already():
    """A moment in the dwell, when nothing moves: stopped at once."""
    rows = trace((300, 0.0))
    seen = arm_after(rows, 100 * MS, now_ns=300 * MS)
    assert (seen.stopped_after_s, seen.descended_m) == (0.0, 0.0)


def test_rest_needs_no_rows():
    """An arm at rest writes one row a second, so silence of the trace is no motion."""
    rows = trace((100, -0.0005), (4, 0.0))
    assert not is_at_rest(rows, now_ns=150 * MS)
    assert is_at_rest(rows, now_ns=900 * MS)


def test_the_rise_counts_from_the_moment():
    """Forces before it do not count; a fall is no rise."""
    forces = [(0, 0.0), (1, 3.0), (2, 1.0), (3, 1.4), (4, 0.2)]
    assert force_rise(forces, 2, until_ns=9) == (1.0, pytest.approx(0.4))
    assert force_rise(forces, 3, until_ns=9) == (1.4, 0.0)
    assert force_rise(forces, 2, until_ns=2) == (1.0, 0.0)


class Spring:
    """A gel of 1 N/mm below the start of the trace."""

    def wrench(self, pose, _stamp_ns):
        """Return force and moment."""
        return (0.0, 0.0, max(0.0, START_Z - pose.position[2]) * 1e3), (0.0, 0.0, 0.0)


def test_the_gel_is_pressed_as_the_arm_went():
    """The pose between two rows is that of the earlier one."""
    rows = trace((1000, -0.0005), (10, 0.0))
    forces = true_forces(Spring(), rows, rotation=(0, 0, 0), start_ns=0, end_ns=1500 * MS)
    assert forces[0] == (0, 0.0)
    assert forces[-1][1] == pytest.approx(0.5)
    assert [force for _, force in forces] == sorted(force for _, force in forces)
