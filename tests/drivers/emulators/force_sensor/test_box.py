"""The command side of the emulated force sensor's box."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.faults import Device, Fault, FaultKind
from drivers.emulators.force_sensor.box import BoxCommands, FrameStream, ReplyStyle
from drivers.force_sensor.sri_wire import FrameParser
from tacauchy_rig.core.config.model import Checksum
from tacauchy_rig.core.run import ForceSample, Vector6


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"AT+SMPF=100\r\n", b"ACK+SMPF=100$OK\r\n"),
        (b"AT+DCKMD=SUM\r\n", b"ACK+DCKMD=SUM$OK\r\n"),
        (b"AT+GSD=STOP\r\n", b"ACK+GSD=STOP$OK\r\n"),
        (b"AT+DCKMD=MD5\r\n", b"ACK+DCKMD=MD5$ERROR\r\n"),
        (b"AT+SMPF=0\r\n", b"ACK+SMPF=0$ERROR\r\n"),
        (b"AT+NOPE=1\r\n", b"ACK+NOPE=1$ERROR\r\n"),
        (b"AT+EXMV=?\r\n", b"ACK+EXMV=5.0;5.0;5.0;5.0;5.0;5.0$OK\r\n"),
        (b"AT+GOD\r\n", b""),
        (b"nonsense\r\n", b""),
    ],
)
def test_replies(line: bytes, reply: bytes) -> None:
    """Each command gets the reply that the documents show."""
    assert BoxCommands().receive(line) == reply


def test_settings_take_effect_and_are_told() -> None:
    """What is set is used, and a query returns it."""
    box = BoxCommands()
    box.receive(b"AT+SMPF=250\r\nAT+DCKMD=CRC32\r\nAT+GSD\r\n")
    assert (box.rate_hz, box.checksum, box.streaming) == (250, Checksum.CRC32, True)
    assert box.receive(b"AT+SMPF=?\r\n") == b"ACK+SMPF=250$OK\r\n"
    box.receive(b"AT+GSD=STOP\r\n")
    assert not box.streaming


def test_older_box_knows_the_other_name() -> None:
    """A box of the older kind refuses the newer name."""
    box = BoxCommands(rate_command="SMPR")
    assert box.receive(b"AT+SMPF=50\r\n") == b"ACK+SMPF=50$ERROR\r\n"
    assert box.receive(b"AT+SMPR=50\r\n") == b"ACK+SMPR=50$OK\r\n"
    assert box.rate_hz == 50


@pytest.mark.parametrize(
    ("style", "reply"), [(ReplyStyle.BARE_OK, b"ACK+SMPF=50OK\r\n"), (ReplyStyle.SILENT, b"")]
)
def test_reply_styles(style: ReplyStyle, reply: bytes) -> None:
    """The box can answer as other documents say, or not at all, and still obeys."""
    box = BoxCommands(style=style)
    assert box.receive(b"AT+SMPF=50\r\n") == reply
    assert box.rate_hz == 50


@settings(deadline=None)
@given(st.lists(st.integers(1, 12), max_size=12))
def test_any_chunking_of_commands(cuts: list[int]) -> None:
    """Commands may arrive in any pieces."""
    data = b"AT+SMPF=200\r\nAT+GSD\r\n"
    box = BoxCommands()
    replies = b""
    for length in [*cuts, len(data)]:
        replies += box.receive(data[:length])
        data = data[length:]
    assert replies == b"ACK+SMPF=200$OK\r\nACK+GSD=$OK\r\n"


PERIOD_NS = 10_000_000


def play(
    count: int, kind: FaultKind | None, amount: float | None = None
) -> tuple[FrameParser, bytes]:
    """Stream ``count`` frames of rising values under one fault; return a parser and the bytes."""
    stream = FrameStream(seed=1, full_scale_n=50.0)
    faults = []
    if kind is not None:
        faults = [Fault(device=Device.FORCE_SENSOR, kind=kind, amount=amount)]
    data = b""
    for index in range(count):
        values: Vector6 = (0.0, 0.0, float(index), 0.0, 0.0, 0.0)
        stamp_ns = index * PERIOD_NS
        stream.next_frame(values, stamp_ns=stamp_ns, faults=faults, checksum=Checksum.SUM)
        data += b"".join(stream.line.due(stamp_ns))
    return FrameParser(), data


def frames_of(count: int, kind: FaultKind | None, amount: float | None = None) -> list[ForceSample]:
    """Return the frames that a client decodes."""
    parser, data = play(count, kind, amount)
    return parser.feed(data)


def test_no_fault() -> None:
    """Every frame leaves at its moment, numbered from zero."""
    frames = frames_of(5, None)
    assert [(f.counter, f.wrench[2]) for f in frames] == [(i, float(i)) for i in range(5)]


def test_freeze_repeats_values_while_the_number_moves() -> None:
    """A frozen sensor keeps counting."""
    frames = frames_of(5, FaultKind.FREEZE)
    assert [f.counter for f in frames] == list(range(5))
    assert {f.wrench[2] for f in frames} == {0.0}


def test_drop_leaves_gaps() -> None:
    """Dropped frames take their numbers with them."""
    parser, data = play(200, FaultKind.DROP, 0.25)
    frames = parser.feed(data)
    assert len(frames) == pytest.approx(150, abs=25)
    assert parser.lost_count == frames[-1].counter - frames[0].counter + 1 - len(frames)
    assert parser.corrupt_frame_count == 0


def test_garble_breaks_the_checksum() -> None:
    """Garbled frames leave, with wrong bytes."""
    parser, data = play(200, FaultKind.GARBLE, 0.25)
    parser.feed(data)
    assert len(data) == 200 * 31
    assert parser.corrupt_frame_count == pytest.approx(50, abs=25)


def test_saturate_pins_fz() -> None:
    """Fz reads full scale and the other channels go on."""
    assert {f.wrench[2] for f in frames_of(3, FaultKind.SATURATE, 12.0)} == {12.0}


def test_lies_leave_numbers_and_checksums_alone() -> None:
    """A sensor that reads a tenth sends whole frames, none missing."""
    parser, data = play(50, FaultKind.SCALE, 0.1)
    frames = parser.feed(data)
    assert [frame.counter for frame in frames] == list(range(50))
    assert [frame.wrench[2] for frame in frames] == pytest.approx([0.1 * i for i in range(50)])
    assert (parser.lost_count, parser.corrupt_frame_count) == (0, 0)


def test_stall_sends_nothing_and_counts_on() -> None:
    """After a stall the number shows how much is missing."""
    stream = FrameStream(seed=1, full_scale_n=50.0)
    stall = [Fault(device=Device.FORCE_SENSOR, kind=FaultKind.STALL)]
    zero: Vector6 = (0.0,) * 6
    for index, faults in enumerate(([], stall, stall, [])):
        stream.next_frame(zero, stamp_ns=index, faults=faults, checksum=Checksum.SUM)
    assert [f.counter for f in FrameParser().feed(b"".join(stream.line.due(10)))] == [0, 3]


def test_delay_and_latency_shift_the_moment_only() -> None:
    """Delayed frames come later, whole and in order."""
    stream = FrameStream(seed=1, full_scale_n=50.0, latency_s=0.002)
    delay = Fault(device=Device.FORCE_SENSOR, kind=FaultKind.DELAY, amount=0.1)
    zero: Vector6 = (0.0,) * 6
    stream.next_frame(zero, stamp_ns=0, faults=[delay], checksum=Checksum.SUM)
    assert stream.line.next_due_ns == 102_000_000
    assert stream.line.due(101_999_999) == []
    assert [len(frame) for frame in stream.line.due(102_000_000)] == [31]
