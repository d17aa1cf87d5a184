"""What is read from the trace of an emulated arm."""

import pytest

from tests.drivers.arm_notes import TraceRow
from tests.studies.fault_table.observation import arm_after, force_rise

MS = 1_000_000
CYCLE_NS = 2 * MS
START_Z = 0.2


def trace(*legs):
    """Return rows of an arm that goes through (duration [ms], velocity in z [m/s])."""
    rows, z = [], START_Z
    for duration_ms, velocity in legs:
        for _ in range(duration_ms * MS // CYCLE_NS):
            row = TraceRow(
                stamp_ns=len(rows) * CYCLE_NS,
                position=(0.0, 0.0, z),
                velocity=(0.0, 0.0, velocity),
                runtime_state=2,
            )
            rows.append(row)
            z += velocity * CYCLE_NS * 1e-9
    return rows


DOWN = -0.0005


@pytest.mark.parametrize(
    ("legs", "moment_ms", "stopped_s", "lowered_m", "at_rest"),
    [
        pytest.param(
            ((500, DOWN), (300, 0.0), (1000, 0.002), (500, 0.0)), 300, 0.2, 0.0, True, id="retracts"
        ),
        # 50 ms on the way down are no stop.
        pytest.param(
            ((100, DOWN), (50, 0.0), (100, DOWN), (200, 0.0)), 90, 0.16, 0.0, True, id="halts"
        ),
        # The worst thing that an arm could do after a fault.
        pytest.param(
            ((100, DOWN), (200, 0.0), (100, DOWN), (300, 0.0)), 50, 0.05, 5e-5, True, id="again"
        ),
        pytest.param(((500, DOWN),), 100, None, 0.0, False, id="never stops"),
        pytest.param(((300, 0.0),), 100, 0.0, 0.0, True, id="stood already"),
    ],
)
def test_stops_and_what_comes_after_are_told_apart(legs, moment_ms, stopped_s, lowered_m, at_rest):
    """When the arm stood still, and whether it went down again."""
    seen = arm_after(trace(*legs), moment_ms * MS, now_ns=sum(ms for ms, _ in legs) * MS)
    assert seen.stopped_after_s == (
        None if stopped_s is None else pytest.approx(stopped_s, abs=0.003)
    )
    assert seen.lowered_after_m == pytest.approx(lowered_m, rel=0.05, abs=1e-12)
    assert seen.at_rest is at_rest


def test_the_rise_counts_from_the_moment():
    """Forces before it do not count; a fall is no rise."""
    forces = [(0, 0.0), (1, 3.0), (2, 1.0), (3, 1.4), (4, 0.2)]
    assert force_rise(forces, 2, until_ns=9) == (1.0, pytest.approx(0.4))
    assert force_rise(forces, 3, until_ns=9) == (1.4, 0.0)
    assert force_rise(forces, 2, until_ns=2) == (1.0, 0.0)
