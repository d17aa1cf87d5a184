"""What the control loop says of an arm that was lost because this computer was held up."""

from __future__ import annotations

import pytest

from protocols.guard.breach import BreachError
from tacauchy_rig.core.errors import DeviceError

ENDED = DeviceError("robot: the program on the controller ended", remedy="start again")


@pytest.mark.parametrize(("held_up_s", "is_blamed"), [(0.15, True), (0.02, False)])
def test_a_starved_watchdog_is_this_computers_fault(laboratory, monkeypatch, held_up_s, is_blamed):
    """A loop that stood longer than the watchdog waits starved it; resume goes on."""
    lab = laboratory()  # its watchdog bites after 100 ms
    for _ in range(10):
        lab.cycle.turn()

    def ended():
        raise ENDED

    monkeypatch.setattr(lab.bench.arm, "state", ended)
    lab.world.clock.sleep(held_up_s)
    with pytest.raises(BreachError) as caught:
        lab.cycle.turn()
    told = "this computer was too busy" in caught.value.message
    assert told is is_blamed
    assert ("resume" in caught.value.remedy) is is_blamed
    assert ENDED.message in caught.value.message
