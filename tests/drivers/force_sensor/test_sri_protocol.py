"""The force sensor's box on the wire: its frames, whole and damaged, and its commands."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.force_sensor.sri_m3733c import (
    FrameParser,
    Reply,
    decode_command,
    encode_command,
    encode_frame,
    encode_reply,
    find_reply,
    frame_length,
)
from tacauchy_rig.core.config.settings import Checksum
from tacauchy_rig.core.run import Vector6

MANUAL = bytes.fromhex("AA55001BC4C7016AF4C0EF7D33C04962C9C0A25CC6BDA6198FBDAFDA693E6E")
# Another box's, from a comment in public code; here its first three values are known.
OTHERS = bytes.fromhex("AA55001B0000C148F2C171712FC29DE194C178A96BC17057E5C19B8CE3C1E7")
MANUAL_VALUES = (-7.637940, -2.804561, -6.293248, -0.096856, -0.069873, 0.228373)
ONES: Vector6 = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)

values6 = st.tuples(*(st.floats(-1e3, 1e3, width=32) for _ in range(6)))
checksums = st.sampled_from(list(Checksum))


def test_manual_example_decodes() -> None:
    """The frame the manual prints gives its package number and six values, and encodes back."""
    (frame,) = FrameParser().feed(MANUAL)
    assert frame.counter == 50375
    assert frame.wrench == pytest.approx(MANUAL_VALUES, abs=5e-7)
    assert encode_frame(frame.counter, frame.wrench) == MANUAL


def test_a_frame_of_another_box_decodes() -> None:
    """Its checksum holds, it is the first of its stream, and it encodes back to its bytes."""
    (frame,) = FrameParser().feed(OTHERS)
    assert frame.counter == 0
    assert frame.wrench[:3] == pytest.approx((-30.286, -43.861, -18.610), abs=5e-4)
    assert encode_frame(frame.counter, frame.wrench) == OTHERS


@pytest.mark.parametrize(("checksum", "length", "field"), [("SUM", 31, 27), ("CRC32", 34, 30)])
def test_length_field_of_each_checksum(checksum: str, length: int, field: int) -> None:
    """The length field counts what follows it, as the manual gives it for both forms."""
    data = encode_frame(1, ONES, checksum=Checksum(checksum))
    assert len(data) == frame_length(Checksum(checksum)) == length
    assert int.from_bytes(data[2:4], "big") == field


@settings(deadline=None)
@given(st.lists(values6, min_size=1, max_size=20), checksums, st.data())
def test_any_chunking_gives_the_same_frames(
    values: list[Vector6], checksum: Checksum, data: st.DataObject
) -> None:
    """However the bytes are cut, the same frames and counts come out."""
    stream = b"".join(encode_frame(65530 + i, v, checksum=checksum) for i, v in enumerate(values))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    parser = FrameParser(checksum=checksum)
    frames = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        frames += parser.feed(stream[start:end])
    assert [frame.wrench for frame in frames] == values
    assert [frame.counter for frame in frames] == [65530 + i for i in range(len(values))]
    assert (parser.lost_count, parser.corrupt_frame_count) == (0, 0)


garbage = st.binary(max_size=70).filter(lambda data: b"\xaa" not in data)


@settings(deadline=None)
@given(st.lists(st.tuples(garbage, values6), min_size=2, max_size=12), checksums)
def test_garbage_between_frames_loses_none(
    pieces: list[tuple[bytes, Vector6]], checksum: Checksum
) -> None:
    """Bytes between frames are counted in units of a frame and cost no valid one."""
    parser = FrameParser(checksum=checksum)
    stream = b"".join(
        junk + encode_frame(i, v, checksum=checksum) for i, (junk, v) in enumerate(pieces)
    )
    frames = parser.feed(stream)
    assert [frame.wrench for frame in frames] == [v for _, v in pieces]
    length = frame_length(checksum)
    damaged = sum(math.ceil(len(junk) / length) for junk, _ in pieces[1:])
    assert (parser.lost_count, parser.corrupt_frame_count) == (0, damaged)


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(0, 30), st.integers(1, 255))
def test_one_flipped_byte_costs_one_frame(index: int, offset: int, flip: int) -> None:
    """Damage inside one frame loses that frame only; a damaged number loses none."""
    frames = [bytearray(encode_frame(i, ONES)) for i in range(43)]
    frames[index][offset] ^= flip
    parser = FrameParser()
    found = parser.feed(b"".join(frames))
    if offset in (4, 5):  # the package number is outside the checksum
        assert len(found) == 43
        assert found[index + 1].counter == index + 1
        assert (parser.lost_count, parser.corrupt_frame_count) == (0, 1)
        return
    assert len(found) == 42
    assert parser.lost_count == 1
    assert parser.corrupt_frame_count == 1


def test_header_inside_a_float_is_not_a_frame() -> None:
    """AA 55 00 1B as the bytes of a float is skipped, even when joined just before it."""
    disguised = bytes.fromhex("AA55001B")
    values: Vector6 = (*(struct.unpack("<f", disguised) * 5), 0.0)
    stream = b"".join(encode_frame(i, values) for i in range(4))
    assert disguised * 5 in stream
    frames = FrameParser().feed(stream[5:])
    assert [frame.counter for frame in frames] == [1, 2, 3]
    assert all(frame.wrench == values for frame in frames)


@settings(deadline=None)
@given(st.integers(0, 65535), st.integers(1, 32766))
def test_gap_is_counted_across_the_wrap(first: int, gap: int) -> None:
    """Missing package numbers are lost frames, also where the number wraps."""
    parser = FrameParser()
    numbers = (first, first + gap + 1, first + gap + 2)
    frames = parser.feed(b"".join(encode_frame(number, ONES) for number in numbers))
    assert [frame.counter for frame in frames] == list(numbers)
    assert (parser.lost_count, parser.corrupt_frame_count) == (gap, 0)


@settings(deadline=None)
@given(st.sets(st.integers(1, 198)))
def test_any_pattern_of_losses_is_counted(missing: set[int]) -> None:
    """Whatever frames are missing, counters stay true and the losses add up."""
    kept = [number for number in range(202) if number not in missing]
    parser = FrameParser()
    frames = parser.feed(b"".join(encode_frame(65500 + number, ONES) for number in kept))
    assert [frame.counter for frame in frames] == [65500 + number for number in kept]
    assert parser.lost_count == len(missing)
    assert parser.corrupt_frame_count == 0


@pytest.mark.parametrize("second", [100, 7])
def test_number_that_repeats_or_runs_backwards_is_a_restart(second: int) -> None:
    """A power cycle of the box is not mistaken for 65000 lost frames."""
    parser = FrameParser()
    numbers = (100, second, second + 1)
    frames = parser.feed(b"".join(encode_frame(number, ONES) for number in numbers))
    assert [frame.counter for frame in frames] == [100, 101, 102]
    assert (parser.lost_count, parser.corrupt_frame_count) == (0, 0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_non_finite_values_are_corrupt(bad: float) -> None:
    """NaN and infinity never become a sample, and are not called lost as well."""
    parser = FrameParser()
    broken: Vector6 = (0.0, 0.0, bad, 0.0, 0.0, 0.0)
    frames = parser.feed(encode_frame(1, ONES) + encode_frame(2, broken) + encode_frame(3, ONES))
    assert [frame.counter for frame in frames] == [1, 3]
    assert (parser.corrupt_frame_count, parser.lost_count) == (1, 0)


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (("GSD", None), b"AT+GSD\r\n"),
        (("GSD", "STOP"), b"AT+GSD=STOP\r\n"),
        (("SMPF", "?"), b"AT+SMPF=?\r\n"),
        (("SGDM", "(A01,A02);E;1;(WMA:1)"), b"AT+SGDM=(A01,A02);E;1;(WMA:1)\r\n"),
    ],
)
def test_commands_on_the_wire(command: tuple[str, str | None], line: bytes) -> None:
    """Commands encode as documented and decode back; noise decodes to nothing."""
    assert encode_command(*command) == line
    assert decode_command(line.strip()) == command
    assert decode_command(b"\xff\x00" + line) is None


@pytest.mark.parametrize("end", [b"$OK\r\n", b"OK\r\n", b"\r\n"])
def test_every_seen_form_of_a_reply(end: bytes) -> None:
    """Replies with ``$OK``, with ``OK`` alone and without either are taken; ERROR is a refusal."""
    assert find_reply(b"ACK+SMPF=100" + end, name="SMPF") == Reply("SMPF", "100")
    refused = Reply("SMPF", "", refused=True)
    assert find_reply(encode_reply(refused) + b"ACK+SMPF=10", name="SMPF") == refused


def test_reply_between_frames_is_found() -> None:
    """A reply that arrives amid streamed frames is found; another name's is not taken."""
    frame = encode_frame(1, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
    data = frame + b"ACK+SMPR=100$OK\r\n" + frame + b"ACK+GSD=STOP$OK\r\n"
    assert find_reply(data, name="GSD") == Reply("GSD", "STOP")
    assert find_reply(data, name="DCKMD") is None
