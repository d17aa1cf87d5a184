"""Feeds: newest things for viewers, dropped and counted where a viewer is slow."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack, closing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols.processes.feed import (
    PICTURES_BYTES,
    FeedLines,
    FeedReader,
    FeedWriter,
    FeedWriters,
    feed_readers,
)


class Line:
    """A feed from a camera to a page, with ends as a child process would inherit them."""

    def __init__(self):
        self.lines = FeedLines([("camera", "page")])
        self._stack = ExitStack()
        self.writer, self.reader = self.ends(FeedWriter, "camera", to="page"), self.new_reader()

    def new_reader(self):
        """Return one more reader, as of a viewer that was started again."""
        return self.ends(FeedReader, "page", source="camera")

    def ends(self, kind, name, **other):
        """Return an end on copies of the descriptors."""
        copies = {what: os.dup(end) for what, end in self.lines.descriptors(name).items()}
        end = kind(copies, **other)
        self._stack.callback(end._channel.close)
        self._stack.callback(os.close, next(d for w, d in copies.items() if "pictures" in w))
        return end

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
def ends(line):
    """Both ends of it."""
    return line.writer, line.reader


def test_what_is_shown_arrives_with_its_picture(ends):
    """Numbers, stamp and bytes, in order."""
    writer, reader = ends
    assert writer.show("twin", 5, {"lag_ms": 12.5}, b"picture")
    assert writer.show("twin", 6, {})
    first, second = reader.receive()
    assert (first.stream, first.stamp_ns, first.numbers) == ("twin", 5, {"lag_ms": 12.5})
    assert (first.picture, second.picture, reader.lost_count) == (b"picture", None, 0)


def test_a_picture_larger_than_a_message_arrives(ends):
    """A full-size camera's JPEG, which no socket takes in one piece."""
    writer, reader = ends
    picture = bytes(range(256)) * 8000
    writer.show("camera", 1, {}, picture)
    assert reader.receive()[0].picture == picture


def test_a_viewer_that_reads_nothing_holds_nobody_up(ends):
    """A thousand pictures to a viewer that stands still: dropped, and counted when it wakes up."""
    writer, reader = ends
    began = time.monotonic()
    results = [writer.show("camera", n, {"counter": n}, b"x" * 100_000) for n in range(5000)]
    assert time.monotonic() - began < 60.0  # it ends at all
    assert not all(results)
    seen = reader.receive()
    writer.show("camera", 5000, {"counter": 5000}, b"last")
    seen += reader.receive()
    assert seen[-1].picture == b"last"
    whole = [shown for shown in seen if shown.picture is not None]
    assert reader.lost_count == 5001 - len(whole)


@settings(deadline=None, max_examples=25)
@given(st.lists(st.integers(1, PICTURES_BYTES // 2), min_size=1, max_size=8))
def test_a_picture_is_whole_or_absent(sizes):
    """Memory that went round never shows a part of one picture as another."""
    with closing(Line()) as line:
        for number, size in enumerate(sizes):
            line.writer.show("camera", number, {}, bytes([number]) * size)
        for number, shown in enumerate(line.reader.receive()):
            assert shown.picture in (None, bytes([number]) * sizes[number])
        assert line.reader.receive() == []


def test_a_picture_that_fits_nowhere_is_left_out(ends):
    """Its numbers still arrive."""
    writer, reader = ends
    writer.show("camera", 1, {"counter": 1}, bytes(PICTURES_BYTES))
    assert reader.receive()[0].picture is None


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
