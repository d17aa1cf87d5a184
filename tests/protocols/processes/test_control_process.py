"""What control shows beside the record: everything once, tared, and never in the record's way."""

from contextlib import closing

import pytest

from protocols.control.cycle import Begin
from protocols.processes.control_process import PERIOD_NS, Broadcast
from protocols.processes.ipc import FeedWriters
from protocols.steps.tare_and_force_window import take_tare
from tests.protocols.processes.test_ipc import Line


@pytest.fixture
def line():
    """A feed to a page."""
    with closing(Line()) as made:
        yield made


def test_every_sample_is_recorded_and_shown_once(laboratory, line):
    """Counters of what is shown are those of what is kept, in order; forces are tared."""
    lab = laboratory()
    broadcast = Broadcast(lab.cycle.sink, line.writer)
    lab.cycle.sink = broadcast
    lab.cycle.observers.append(lambda: broadcast.show(lab.cycle))
    broadcast.put(Begin(1, 1))
    lab.cycle.force_guard.set_zero(take_tare(lab.cycle))
    for _ in range(40):
        lab.cycle.turn()
    shown = list(line.reader.receive())
    counters = [n for one in shown if one.stream == "force" for n in one.numbers["counter"]]
    kept = [sample.counter for sample in lab.sink.samples]
    assert counters == kept[: len(counters)]
    assert len(kept) - len(counters) <= 2 * PERIOD_NS // 10_000_000
    newest = [one for one in shown if one.stream == "force"][-1].numbers
    assert abs(newest["force_n"][-1]) < 0.1
    assert any(one.stream == "arm" for one in shown)


def test_without_viewers_nothing_is_kept(laboratory):
    """Nothing piles up where nobody watches."""
    lab = laboratory()
    broadcast = Broadcast(lab.cycle.sink, FeedWriters({}, ()))
    lab.cycle.sink = broadcast
    for _ in range(40):
        lab.cycle.turn()
        broadcast.show(lab.cycle)
    assert broadcast._waiting == ()
