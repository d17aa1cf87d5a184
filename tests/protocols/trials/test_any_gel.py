"""Invariants of a whole trial on gels and mountings that nobody has seen before."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.mock.world import Gel
from tacauchy_rig.core.run import Outcome

OVERRUN_N = 0.15
NEAR = (
    'robot.home=["0 mm", "-400 mm", "203 mm"]',
    'protocol.approach_height="1.1 mm"',
    'protocol.air_press_height="1.5 mm"',
)
"""Short ways at the speeds that are shipped."""


@settings(max_examples=6, deadline=None)
@given(
    stiffness=st.floats(800, 20_000),
    relaxed=st.floats(0.0, 0.12),
    time_s=st.floats(0.3, 8.0),
    offset_m=st.floats(-0.9e-3, 0.9e-3),
    delay_s=st.floats(0.0, 0.06),
    target_n=st.floats(1.0, 5.5),
)
def test_no_gel_makes_the_arm_leave_its_limits(
    laboratory, stiffness, relaxed, time_s, offset_m, delay_s, target_n
):
    """The force stays below the soft limit plus the overrun and the tip inside its box."""
    gel = Gel(stiffness_n_m=stiffness, relaxed_fraction=relaxed, relaxation_time_s=time_s)
    lab = laboratory(
        f'protocol.force_targets=["{target_n} N"]',
        "protocol.attempts=1",
        ways=NEAR,
        gel=gel,
        surface_offset_m=offset_m,
        motion_delay_s=delay_s,
    )
    peak_n, lowest_m = 0.0, 1.0

    def look(_now_ns):
        nonlocal peak_n, lowest_m
        peak_n = max(peak_n, lab.world.force_n)
        lowest_m = min(lowest_m, lab.world.pose.position[2])

    lab.world.on_step(look)
    result = lab.run()
    assert peak_n <= lab.config.limits.soft_force + OVERRUN_N
    assert lowest_m >= lab.config.workspace.z_min
    assert lowest_m >= lab.world.surface_z_m - lab.config.limits.max_depth - 0.2e-3
    assert lab.world.force_n == 0.0
    if result.outcome is Outcome.FAULT:
        assert result.records[0].reason.startswith("limits.max_depth")
    else:
        assert peak_n <= target_n + OVERRUN_N
