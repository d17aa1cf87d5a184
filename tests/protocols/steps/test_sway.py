"""A press that sways after its dwell."""

from __future__ import annotations

import numpy as np

from protocols.trials.programme import fresh_plan, run_programme


def _swaying(laboratory):
    lab = laboratory('protocol.force_targets=["2 N"]', 'protocol.sway="4 s"')
    result = run_programme(lab.cycle, lab.journal, fresh_plan(lab.config))
    stamps = {e.detail["phase"]: e.stamp_ns for e in lab.sink.events if e.name == "phase"}
    states = [s for s in lab.sink.states if stamps["sway"] <= s.stamp_ns <= stamps["retract"]]
    return lab, result.records[0], states


def test_it_sways_for_as_long_as_asked_between_dwell_and_retract(laboratory):
    """The trial passes, and its phases are in order."""
    lab, record, states = _swaying(laboratory)
    assert record.passed
    assert lab.phases[-5:] == ["dwell", "sway", "retract", "drift-check", "verdict"]
    assert 3.9e9 < states[-1].stamp_ns - states[0].stamp_ns < 4.2e9


def test_it_never_goes_deeper_than_the_press_and_slower_than_its_speed(laboratory):
    """Up from where the force was held, by some 0.05 mm, and no faster than press_speed."""
    lab, record, states = _swaying(laboratory)
    depth_m = record.contact_z_m - np.array([state.pose.position[2] for state in states])
    assert depth_m.max() < record.depth_measured_m + 5e-6
    assert 30e-6 < np.ptp(depth_m) < 90e-6
    assert max(abs(state.velocity[2]) for state in states) <= 1.01 * lab.config.robot.press_speed
