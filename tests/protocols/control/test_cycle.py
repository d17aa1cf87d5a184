"""What the control loop says of an arm that was lost because this computer was held up."""

from __future__ import annotations

import pytest

from drivers.interfaces import ProgramEndedError
from protocols.guard.breach import BreachError
from tacauchy_rig.core.errors import DeviceError

ENDED = ProgramEndedError("robot: the program on the controller ended", remedy="start again")
STOPPED = DeviceError("robot: a person stopped it at the pendant", remedy="unlock it")


@pytest.mark.parametrize(
    ("error", "held_up_s", "is_blamed"),
    [(ENDED, 0.15, True), (ENDED, 0.02, False), (STOPPED, 0.15, False)],
)
def test_a_starved_watchdog_is_this_computers_fault(
    laboratory, monkeypatch, error, held_up_s, is_blamed
):
    """A loop that stood longer than the watchdog waits starved it; resume goes on."""
    lab = laboratory()  # its watchdog bites after 100 ms
    for _ in range(10):
        lab.cycle.turn()

    def lost():
        raise error

    monkeypatch.setattr(lab.bench.arm, "state", lost)
    lab.world.clock.sleep(held_up_s)
    with pytest.raises(BreachError) as caught:
        lab.cycle.turn()
    assert ("this computer was too busy" in caught.value.message) is is_blamed
    assert ("resume" in caught.value.remedy) is is_blamed
    assert error.message in caught.value.message
    assert is_blamed or caught.value.remedy == error.remedy
