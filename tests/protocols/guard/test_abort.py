"""A person's wish to stop."""

from __future__ import annotations

import pytest

from protocols.guard.abort import Abort
from protocols.programme import fresh_plan, run_programme
from tacauchy_rig.run import Outcome


@pytest.mark.parametrize("phase", ["preflight", "air-press", "tare", "search", "press", "dwell"])
def test_an_abort_stops_the_arm_in_every_phase(laboratory, phase):
    """The outcome is aborted, nothing moves any more and the gel is left."""
    lab = laboratory('protocol.force_targets=["3 N"]')
    lab.when_phase(phase, lambda: lab.abort.request("a key was pressed"), delay_s=0.2)
    result = run_programme(lab.cycle, lab.journal, fresh_plan(lab.config))
    assert result.outcome is Outcome.ABORTED
    assert result.reason.startswith("aborted: a key was pressed")
    assert all(record.outcome is Outcome.ABORTED for record in lab.sink.records)
    lab.world.clock.sleep(1.0)
    lab.world.catch_up()
    assert lab.world.velocity == (0.0,) * 6
    assert lab.world.force_n == 0.0


def test_a_second_abort_holds_the_arm_where_it_is(laboratory):
    """Asked again during the retract, the arm stays, even in the gel."""
    lab = laboratory('protocol.force_targets=["4 N"]')
    lab.when_phase("dwell", lambda: lab.abort.request("first"), delay_s=0.2)
    lab.when_phase("dwell", lambda: lab.abort.request("second"), delay_s=0.8)
    result = run_programme(lab.cycle, lab.journal, fresh_plan(lab.config))
    assert "holds where it is" in result.reason
    lab.world.clock.sleep(1.0)
    lab.world.catch_up()
    assert lab.world.velocity == (0.0,) * 6
    assert lab.world.force_n > 0.1


def test_one_wish_that_arrives_several_times_is_one():
    """Ctrl-C reaches the supervisor and control: within a moment it is the same wish."""
    abort = Abort()
    heard = []
    abort.on_request(heard.append)
    abort.request("Ctrl-C")
    abort.request("Ctrl-C")
    assert (abort.count, abort.reason, heard) == (1, "Ctrl-C", ["Ctrl-C"])
