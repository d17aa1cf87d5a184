"""Entries on a stream, in whatever pieces it delivers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from protocols.control.record import Begin, Force
from protocols.processes.framing import EntryReader, encode
from tacauchy_rig.run import ForceSample, ImageFrame, Wrench

ENTRIES = [
    Begin(1, 2),
    Force(
        (
            ForceSample(
                stamp_ns=5, counter=6, wrench=Wrench(force=(1.0, 2.0, 3.0), torque=(0.0, 0.0, 0.0))
            ),
        )
    ),
    ImageFrame(
        stamp_ns=1, counter=2, device_stamp_s=None, width=3, height=4, jpeg=b"\xff\xd8" * 400
    ),
]


@given(st.lists(st.integers(1, 400), min_size=1))
def test_entries_survive_any_cutting(sizes):
    """However the stream is cut, every entry comes out once, with its number."""
    stream = b"".join(encode(number, entry) for number, entry in enumerate(ENTRIES, start=10))
    reader, found, position, turn = EntryReader(), [], 0, 0
    while position < len(stream):
        size = sizes[turn % len(sizes)]
        found += reader.feed(stream[position : position + size])
        position += size
        turn += 1
    assert found == list(enumerate(ENTRIES, start=10))


def test_half_an_entry_is_no_entry():
    """A producer killed in the middle of a message leaves nothing half-read."""
    whole = encode(1, ENTRIES[2])
    assert EntryReader().feed(whole[:-1]) == []
