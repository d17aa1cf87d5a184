"""Six presses from preflight to verdict."""

from hypothesis import given, settings
from hypothesis import strategies as st

from tacauchy_rig.core.run import Outcome
from tests.mock.world import Gel
from tests.protocols.conftest import NEAR


def test_six_trials_pass_within_tolerance(laboratory):
    """All six targets are held with a mean inside the configured tolerance."""
    lab = laboratory()
    result = lab.run()
    assert result.outcome is Outcome.PASSED
    assert [record.index for record in result.records] == [1, 2, 3, 4, 5, 6]
    for record, target in zip(result.records, lab.config.protocol.force_targets, strict=True):
        assert abs(record.force_measured_n - target) <= lab.config.protocol.force_tolerance
        assert all(criterion.passed for criterion in record.criteria)


def test_a_trial_goes_through_its_phases_in_order(laboratory):
    """The journal names every phase once, the record keeps every raw sample, speeds are kept."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    lab.run()
    in_order = "preflight air-press home tare reference approach search press dwell retract"
    assert lab.phases == [*in_order.split(), "drift-check", "verdict"]
    counters = [sample.counter for sample in lab.sink.samples]
    assert counters == list(range(counters[0], counters[0] + len(counters)))
    assert abs(lab.sink.samples[5].wrench[2] - 1.4) < 0.1, "bias included"
    assert lab.bench.arm.watchdog_stops == 0
    assert lab.bench.arm.fastest_m_s <= 1.01 * lab.config.robot.approach_speed


def test_what_was_measured_agrees_with_the_mock_world(laboratory):
    """Contact height, depth, dwell length and drift are those of the world behind the mocks."""
    lab = laboratory('protocol.force_targets=["2 N"]', surface_offset_m=0.0004)
    record = lab.run().records[0]
    assert abs(record.contact_z_m - (0.2 + 0.0004)) < 30e-6
    stiffness = record.force_measured_n / record.depth_measured_m
    assert 0.9 * 3500 < stiffness < 1.1 * 3500
    assert record.dwell_end_ns - record.dwell_start_ns >= 1.2e9
    assert record.reference_end_ns < record.dwell_start_ns
    span_s = (record.tare_after.start_ns - record.tare_before.start_ns) * 1e-9
    assert abs(record.force_drift_n - 0.0007 * span_s) < 0.005
    assert record.rates["force_lost_count"] == 0
    assert round(record.rates["force_rate_hz"]) == 100
    assert abs(record.rates["image_rate_hz"] - 18.75) < 0.1  # what a GelSight Mini delivers


def test_a_sensor_mounted_the_other_way_round_presses_all_the_same(laboratory):
    """compression_sign = -1 turns raw tension into pressing force."""
    lab = laboratory('protocol.force_targets=["2 N"]', "force_sensor.compression_sign=-1")
    record = lab.run().records[0]
    assert record.passed
    assert abs(record.force_measured_n - 2.0) <= lab.config.protocol.force_tolerance


def test_drift_beyond_its_limit_fails_the_trial_and_it_is_tried_again(laboratory):
    """A wandering zero makes the attempt fail, with a remedy; the next attempt follows."""
    lab = laboratory('protocol.force_targets=["2 N"]', drift_n_s=0.01)
    result = lab.run()
    assert result.outcome is Outcome.FAILED
    assert lab.sink.begun == [(1, 1), (1, 2)]
    missed = [c for c in result.records[0].criteria if not c.passed]
    assert [criterion.name for criterion in missed] == ["force_drift"]
    assert "warm up" in missed[0].remedy


def test_a_noisy_tare_never_presses(laboratory):
    """When the unloaded force is not quiet, nothing is pressed."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    lab.when_phase("home", lambda: setattr(lab.world, "noise_n", 0.06))
    result = lab.run()
    assert result.outcome is Outcome.FAILED
    assert "press" not in lab.phases
    assert "tare_deviation" in result.records[0].reason


OVERRUN_N = 0.15


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
