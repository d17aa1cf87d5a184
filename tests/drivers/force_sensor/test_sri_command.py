"""Text commands of the force sensor's box and the variants of their replies."""

from __future__ import annotations

import pytest

from drivers.force_sensor.sri_command import (
    Command,
    Reply,
    decode_command,
    encode_command,
    encode_reply,
    find_reply,
)
from drivers.force_sensor.sri_frame import encode_frame


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (Command(name="GSD"), b"AT+GSD\r\n"),
        (Command(name="GSD", value="STOP"), b"AT+GSD=STOP\r\n"),
        (Command(name="SMPF", value="?"), b"AT+SMPF=?\r\n"),
        (
            Command(name="SGDM", value="(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)"),
            b"AT+SGDM=(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)\r\n",
        ),
    ],
)
def test_commands_on_the_wire(command: Command, line: bytes) -> None:
    """Commands encode as documented and decode back."""
    assert encode_command(command) == line
    assert decode_command(line.strip()) == command


def test_noise_is_no_command() -> None:
    """A line that is no command decodes to nothing."""
    assert decode_command(b"\xff\x00AT") is None
    assert decode_command(b"hello") is None


@pytest.mark.parametrize("end", [b"$OK\r\n", b"OK\r\n", b"\r\n"])
def test_every_seen_form_of_a_reply(end: bytes) -> None:
    """Replies with ``$OK``, with ``OK`` alone and without either are taken."""
    assert find_reply(b"ACK+SMPF=100" + end, name="SMPF") == Reply(name="SMPF", value="100")


def test_refusal_is_seen() -> None:
    """A reply that says ERROR is a refusal."""
    sent = Reply(name="SMPF", value="", refused=True)
    assert find_reply(encode_reply(sent), name="SMPF") == sent


def test_reply_between_frames_is_found() -> None:
    """A reply that arrives amid streamed frames is found; another name's is not taken."""
    frame = encode_frame(1, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
    data = frame + b"ACK+SMPR=100$OK\r\n" + frame + b"ACK+GSD=STOP$OK\r\n"
    assert find_reply(data, name="GSD") == Reply(name="GSD", value="STOP")
    assert find_reply(data, name="DCKMD") is None


def test_incomplete_reply_is_not_taken() -> None:
    """Half a reply is no reply."""
    assert find_reply(b"ACK+SMPF=10", name="SMPF") is None
