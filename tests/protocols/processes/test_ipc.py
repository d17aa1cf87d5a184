"""Messages between processes: whole, in order, never blocking."""

import os
from contextlib import ExitStack, closing

import pytest

from protocols.processes.ipc import Channel, FeedLines, FeedReader, FeedWriters, feed_readers


@pytest.fixture
def ends():
    """Return two connected channels."""
    one, other = Channel.pair()
    yield one, other
    one.close()
    other.close()


def test_messages_arrive_whole_and_in_order(ends):
    """What is sent is received, once; what was not asked for stays in line."""
    one, other = ends
    for message in ("job", {"a": 1}, "stop"):
        assert one.send(message)
    assert other.wait(1.0)
    assert other.receive(limit=1) == ["job"]
    assert other.receive() == [{"a": 1}, "stop"]
    assert other.receive() == []


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


class Line:
    """A feed from a camera to a page, with ends as a child process would inherit them."""

    def __init__(self):
        self.lines = FeedLines([("camera", "page")])
        self._stack = ExitStack()
        self.writer = FeedWriters({"page-feed": os.dup(self._end("camera"))}, ["page"])
        self._stack.callback(self.writer._channels[0].close)
        self.reader = self.new_reader()

    def _end(self, name):
        return next(iter(self.lines.descriptors(name).values()))

    def new_reader(self):
        """Return one more reader, as of a viewer that was started again."""
        channel = Channel.inherited(os.dup(self._end("page")))
        self._stack.callback(channel.close)
        return FeedReader(channel)

    def close(self):
        """Close everything."""
        self._stack.close()
        self.lines.close()


@pytest.fixture
def line():
    """A feed from a camera to a page."""
    with closing(Line()) as made:
        yield made


@pytest.fixture
def feed_ends(line):
    """Both ends of it."""
    return line.writer, line.reader


def test_what_is_shown_arrives_with_its_picture(feed_ends):
    """Numbers, stamp and bytes, in order."""
    writer, reader = feed_ends
    writer.show("twin", 5, {"lag_ms": 12.5}, b"picture")
    writer.show("twin", 6, {})
    first, second = reader.receive()
    assert (first.stream, first.stamp_ns, first.numbers) == ("twin", 5, {"lag_ms": 12.5})
    assert (first.picture, second.picture, reader.lost_count) == (b"picture", None, 0)


def test_a_picture_larger_than_a_message_arrives_at_every_viewer():
    """A full-size camera's JPEG, which no socket takes in one piece."""
    picture = bytes(range(256)) * 80_000
    with closing(FeedLines([("camera", "page"), ("camera", "twin")])) as lines:
        copies = {what: os.dup(end) for what, end in lines.descriptors("camera").items()}
        writer = FeedWriters(copies, ["page", "twin"])
        writer.show("camera", 1, {}, picture)
        for name in ("page", "twin"):
            [end] = lines.descriptors(name).values()
            [reader] = feed_readers({"camera-feed": os.dup(end)}, ["camera"])
            assert [shown.picture for shown in reader.receive()] == [picture]
            reader._channel.close()
        for channel in writer._channels:
            channel.close()


def test_a_viewer_that_reads_nothing_holds_nobody_up(feed_ends):
    """A thousand pictures to a viewer that stands still: dropped, and counted when it wakes up."""
    writer, reader = feed_ends
    for n in range(5000):
        writer.show("camera", n, {"counter": n}, b"x" * 100_000)
    seen = list(reader.receive())
    assert len(seen) < 5000
    writer.show("camera", 5000, {"counter": 5000}, b"last")
    seen += reader.receive()
    assert seen[-1].picture == b"last"
    assert reader.lost_count == 5001 - len(seen)


def test_without_memory_the_numbers_still_arrive(feed_ends, monkeypatch):
    """A picture that nothing can hold is counted as lost."""
    writer, reader = feed_ends
    monkeypatch.setattr(os, "memfd_create", _refuse)
    writer.show("camera", 1, {"counter": 1}, b"picture")
    [shown] = reader.receive()
    assert (shown.numbers, shown.picture, reader.lost_count) == ({"counter": 1}, None, 1)


def _refuse(_name):
    raise OSError("no memory")


def test_a_viewer_started_again_goes_on(line):
    """The supervisor keeps the sockets, so a new reader hears what comes next."""
    line.writer.show("camera", 1, {}, b"before")
    again = line.new_reader()
    line.writer.show("camera", 2, {}, b"after")
    assert [shown.picture for shown in again.receive()] == [b"before", b"after"]


def test_without_viewers_nothing_is_made(line):
    """A process that nobody views has no feed to show anything to."""
    assert not FeedWriters(line.lines.descriptors("control"), ["page"])
    assert feed_readers(line.lines.descriptors("page"), ["control"]) == []


def test_last_words_arrive_from_an_end_that_left_messages_unread(ends):
    """Linux reports the reset before it delivers what was sent earlier."""
    one, other = ends
    one.send("an order")
    other.send("why it ends")
    other.close()
    assert one.receive() == ["why it ends"]
    assert one.closed
