"""The command side of the emulated force sensor's box."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.force_sensor.box import BoxCommands
from tacauchy_rig.core.config.model import Checksum


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"AT+SMPF=100\r\n", b"ACK+SMPF=100$OK\r\n"),
        (b"AT+DCKMD=SUM\r\n", b"ACK+DCKMD=SUM$OK\r\n"),
        (b"AT+GSD=STOP\r\n", b"ACK+GSD=STOP$OK\r\n"),
        (b"AT+DCKMD=MD5\r\n", b"ACK+DCKMD=MD5$ERROR\r\n"),
        (b"AT+SMPF=0\r\n", b"ACK+SMPF=0$ERROR\r\n"),
        (b"AT+NOPE=1\r\n", b"ACK+NOPE=1$ERROR\r\n"),
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
    box = BoxCommands(quirks=frozenset({"smpr"}))
    assert box.receive(b"AT+SMPF=50\r\n") == b"ACK+SMPF=50$ERROR\r\n"
    assert box.receive(b"AT+SMPR=50\r\n") == b"ACK+SMPR=50$OK\r\n"
    assert box.rate_hz == 50


@pytest.mark.parametrize(("quirk", "reply"), [("bare", b"ACK+SMPF=50OK\r\n"), ("silent", b"")])
def test_reply_styles(quirk: str, reply: bytes) -> None:
    """The box can answer as other documents say, or not at all, and still obeys."""
    box = BoxCommands(quirks=frozenset({quirk}))
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
