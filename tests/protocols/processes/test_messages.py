"""Messages and entries between processes: whole, in order, never blocking."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.control.record import Begin
from protocols.processes.messages import Channel, EntryReader, pack_entry
from tacauchy_rig.core.run import ForceSample, ImageFrame, Wrench


@pytest.fixture
def ends():
    """Return two connected channels."""
    one, other = Channel.pair()
    yield one, other
    one.close()
    other.close()


def test_messages_arrive_whole_and_in_order(ends):
    """What is sent is received, once."""
    one, other = ends
    assert one.send({"a": 1})
    assert one.send("b")
    assert other.wait(1.0)
    assert other.receive() == [{"a": 1}, "b"]
    assert other.receive() == []


def test_messages_can_be_taken_one_at_a_time(ends):
    """What was not asked for stays in line."""
    one, other = ends
    one.send("job")
    one.send("stop")
    assert other.receive(limit=1) == ["job"]
    assert other.receive() == ["stop"]


def test_a_reader_that_sleeps_does_not_block_the_writer(ends):
    """When the buffer is full, ``send`` says so at once."""
    one, other = ends
    sent = 0
    while one.send("x" * 1000):
        sent += 1
    assert sent > 10
    assert len(other.receive()) == sent
    assert one.send("again")


def test_the_end_of_the_other_side_is_seen(ends):
    """A closed end shows on both sending and receiving; what was sent before still arrives."""
    one, other = ends
    one.send("last")
    one.close()
    assert not other.send("too late")
    assert not other.closed
    assert other.receive() == ["last"]
    assert other.closed


ENTRIES = [
    Begin(1, 2),
    (
        ForceSample(
            stamp_ns=5, counter=6, wrench=Wrench(force=(1.0, 2.0, 3.0), torque=(0.0, 0.0, 0.0))
        ),
    ),
    (
        ImageFrame(
            stamp_ns=1, counter=2, device_stamp_s=None, width=3, height=4, jpeg=b"\xff\xd8" * 400
        ),
    ),
]


@given(st.lists(st.integers(1, 400), min_size=1))
def test_entries_survive_any_cutting(sizes):
    """However the stream is cut, every entry comes out once, with its number."""
    stream = b"".join(pack_entry(number, entry) for number, entry in enumerate(ENTRIES, start=10))
    reader, found, position, turn = EntryReader(), [], 0, 0
    while position < len(stream):
        size = sizes[turn % len(sizes)]
        found += reader.feed(stream[position : position + size])
        position += size
        turn += 1
    assert found == list(enumerate(ENTRIES, start=10))


def test_half_an_entry_is_no_entry():
    """A producer killed in the middle of a message leaves nothing half-read."""
    whole = pack_entry(1, ENTRIES[2])
    assert EntryReader().feed(whole[:-1]) == []
