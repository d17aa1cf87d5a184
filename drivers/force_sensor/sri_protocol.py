"""What goes over the wire of an SRI M8128-family box: text commands there, binary frames back.

Commands are ``AT+NAME=value`` and are answered ``ACK+NAME=value``. Documents and users disagree on
the end of a reply (``$OK``, ``OK`` alone or nothing) and on whether streaming is acknowledged, so
the decoder takes all of them.

A frame holds six float32 channels at one point in time:

=======  ======  ==============================================================
offset   length  content
=======  ======  ==============================================================
0        2       AA 55
2        2       length of what follows, big-endian: 27 (SUM) or 30 (CRC32)
4        2       package number, big-endian, wraps at 65536
6        24      Fx Fy Fz [N] Mx My Mz [N m], float32 little-endian
30       1 or 4  SUM: low byte of the sum of bytes 6-29; CRC32: see below
=======  ======  ==============================================================

The SUM form is checked against the example in the manual. The CRC32 form is unconfirmed: only its
length is documented, so the common CRC-32 of bytes 6-29, little-endian, is assumed here.
"""

import math
import re
import struct
import zlib
from typing import NamedTuple

from tacauchy_rig.core.config.settings import Checksum
from tacauchy_rig.core.run import ForceSample, Vector6

MARK = b"\xaa\x55"
NUMBER_MODULUS = 1 << 16
_HEADER = struct.Struct(">2sHH")
_VALUES = struct.Struct("<6f")
_CHECK_LENGTH = {Checksum.SUM: 1, Checksum.CRC32: 4}
_BODY_START = 4

LINE_END = b"\r\n"
_REPLY = re.compile(rb"ACK\+([A-Z0-9]+)=([^\r\n]*?)\$?(OK|ERROR|ERR)?\r\n")
_COMMAND = re.compile(r"AT\+([A-Z0-9]+)(?:=(.*))?")


class Reply(NamedTuple):
    """An answer of the box; ``refused`` only where it says ERROR."""

    name: str
    value: str
    refused: bool = False


def encode_command(name: str, value: str | None = None) -> bytes:
    """Encode a command, for example ``AT+DCKMD=SUM``; the value ``?`` asks."""
    return b"AT+" + (name if value is None else f"{name}={value}").encode("ascii") + LINE_END


def decode_command(line: bytes) -> tuple[str, str | None] | None:
    """Return name and value of one line without its end; None where it is no command."""
    match = _COMMAND.fullmatch(line.decode("ascii", "replace").strip())
    return None if match is None else (match.group(1), match.group(2))


def encode_reply(reply: Reply) -> bytes:
    """Encode a reply, for example ``ACK+SMPF=100$OK``."""
    end = "$ERROR" if reply.refused else "$OK"
    return f"ACK+{reply.name}={reply.value}{end}".encode("ascii") + LINE_END


def find_reply(data: bytes, *, name: str) -> Reply | None:
    """Return the newest complete reply to ``name`` in ``data``, which may hold frames as well."""
    matches = [match for match in _REPLY.finditer(data) if match.group(1) == name.encode("ascii")]
    if not matches:
        return None
    _, value, end = matches[-1].groups()
    return Reply(name, value.decode("ascii", "replace"), refused=(end or b"").startswith(b"ERR"))


def frame_length(checksum: Checksum) -> int:
    """Return the length of a whole frame in bytes: 31 with SUM, 34 with CRC32."""
    return _HEADER.size + _VALUES.size + _CHECK_LENGTH[checksum]


def encode_frame(number: int, values: Vector6, *, checksum: Checksum = Checksum.SUM) -> bytes:
    """Encode a frame as the box sends it; ``number`` is wrapped to 16 bits."""
    data = _VALUES.pack(*values)
    body_length = frame_length(checksum) - _BODY_START
    header = _HEADER.pack(MARK, body_length, number % NUMBER_MODULUS)
    return header + data + _check(data, checksum)


def _check(data: bytes, checksum: Checksum) -> bytes:
    if checksum is Checksum.SUM:
        return bytes([sum(data) & 0xFF])
    return struct.pack("<I", zlib.crc32(data))


class _Jump(NamedTuple):
    """Package number and counter before a jump, and its size modulo 65536."""

    number: int
    counter: int
    step: int

    @property
    def is_forward(self) -> bool:
        return 0 < self.step < NUMBER_MODULUS // 2


class FrameParser:
    """Find frames in a byte stream that arrives in arbitrary pieces.

    A header counts only with the right length and checksum, because AA 55 can occur inside a
    float; otherwise the search goes on one byte further, so damage costs the damaged frames alone.
    A jump of the package number counts once the next frame confirms it, because the number lies
    outside the checksum and may itself be damaged.
    """

    def __init__(self, *, checksum: Checksum = Checksum.SUM) -> None:
        self._checksum = checksum
        self._length = frame_length(checksum)
        self._start = MARK + (self._length - _BODY_START).to_bytes(2, "big")
        self._buffer = bytearray()
        self._damage_length = 0
        self._last_number: int | None = None
        self._counter = 0
        self._jump: _Jump | None = None
        # Frames missing by the package number; a damaged frame is missing too. Where the number
        # repeated or ran backwards, as after a power cycle of the box, it is unknown.
        self.lost_count = 0
        # Damaged stretches in units of a frame, at least one each; frames with a right checksum
        # that hold NaN or infinity, which are never returned; and frames whose package number alone
        # was damaged, which are.
        self.corrupt_frame_count = 0

    def feed(self, data: bytes, *, stamp_ns: int = 0) -> list[ForceSample]:
        """Add bytes that arrived at ``stamp_ns``; return the samples they complete, oldest first.

        Where a package number arrived damaged, which the checksum does not cover, one sample
        carries a wrong counter and the next goes on as before.
        """
        self._buffer += data
        samples: list[ForceSample] = []
        while (raw := self._next_raw()) is not None:
            self._count(_HEADER.unpack_from(raw)[2])
            values: Vector6 = _VALUES.unpack_from(raw, _HEADER.size)
            if all(map(math.isfinite, values)):
                samples.append(ForceSample(stamp_ns=stamp_ns, counter=self._counter, wrench=values))
            else:
                self.corrupt_frame_count += 1
        return samples

    def _next_raw(self) -> bytes | None:
        while True:
            position = self._buffer.find(self._start)
            if position < 0:
                # The last bytes may be the beginning of a header.
                ends = (n for n in (3, 2, 1) if self._buffer.endswith(self._start[:n]))
                self._skip(len(self._buffer) - next(ends, 0))
                return None
            self._skip(position)
            if len(self._buffer) < self._length:
                return None
            raw = bytes(self._buffer[: self._length])
            data_end = _HEADER.size + _VALUES.size
            if _check(raw[_HEADER.size : data_end], self._checksum) == raw[data_end:]:
                del self._buffer[: self._length]
                self._damage_length = 0
                return raw
            self._skip(1)

    def _skip(self, length: int) -> None:
        del self._buffer[:length]
        if self._last_number is None:  # replies, or a frame joined in the middle
            return
        before = math.ceil(self._damage_length / self._length)
        self._damage_length += length
        self.corrupt_frame_count += math.ceil(self._damage_length / self._length) - before

    def _count(self, number: int) -> None:
        if self._last_number is None:
            self._counter = number
        elif self._jump is not None and number == (self._jump.number + 2) % NUMBER_MODULUS:
            self.corrupt_frame_count += 1
            self._counter = self._jump.counter + 2
            self._jump = None
        else:
            if self._jump is not None and self._jump.is_forward:  # the next frame confirms it
                self.lost_count += self._jump.step - 1
            step = (number - self._last_number) % NUMBER_MODULUS
            jump = _Jump(self._last_number, self._counter, step)
            self._jump = None if step == 1 else jump
            self._counter += step if jump.is_forward else 1
        self._last_number = number
