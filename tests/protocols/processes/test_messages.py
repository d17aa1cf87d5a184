"""Messages between processes: whole, in order, never blocking."""

from __future__ import annotations

import pytest

from protocols.processes.messages import Channel


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
