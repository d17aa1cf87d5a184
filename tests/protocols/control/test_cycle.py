"""What the control loop says of an arm that was lost because this computer was held up."""

import numpy as np
import pytest

from drivers.interfaces import FrameMark, ProgramEndedError, StreamHealth
from protocols.control.cycle import RateMeter, lateness_ms
from protocols.guard.breach_reaction import BreachError
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


def test_lateness_is_that_of_the_late_samples_alone() -> None:
    """One sample of a 25 Hz stream that is 30 ms late reads so; a lost one changes nothing."""
    counters = [n for n in range(500) if n != 100]
    stamps_ns = [5_000_000_000 + n * 40_000_000 for n in counters]
    stamps_ns[250] += 30_000_000
    late_ms = lateness_ms(stamps_ns, counters)
    assert late_ms[250] == pytest.approx(30.0, abs=0.1)
    assert np.delete(late_ms, 250).max() < 0.2


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_samples_are_not_late(count: int) -> None:
    """Nothing is said of a stream that has not moved."""
    assert lateness_ms([1] * count, [1] * count).tolist() == [0.0] * count


@pytest.mark.parametrize(
    ("before", "window", "count"),
    [
        ((1, 2, 3), (4, 5, 6, 7), 0),
        ((1, 2, 3), (4, 5, 4, 6), 2),  # two that are one another
        ((1, 2, 3), (4, 2, 5, 6), 1),  # one of before contact
        ((1, 1, 1), (4, 5, 6, 7), 0),  # before contact is not judged
    ],
)
def test_frames_that_repeat_are_counted(before, window, count) -> None:
    """By the digests of their bytes, within the window and against the one before."""
    meter = RateMeter()
    marks = [FrameMark(number, number, digest=d) for number, d in enumerate((*before, *window))]
    meter.frames(marks, StreamHealth())
    assert meter.repeated_frame_count((0, 2), (3, 6)) == count
