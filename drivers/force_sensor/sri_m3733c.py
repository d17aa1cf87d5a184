"""Driver of an SRI M3733C force/torque sensor behind an M8128-family box on a serial port.

Not yet tried with a real box. Documents disagree on the name of the rate command (SMPF or SMPR)
and on what is acknowledged: both names are tried, and a missing acknowledgement is noted in the
identity's settings instead of being an error. What counts is that valid frames arrive.

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

import errno
import logging
import math
import os
import re
import struct
import termios
import threading
import time
import zlib
from pathlib import Path
from typing import NamedTuple

import serial
from serial.tools import list_ports

from drivers.device_holders import device_holders
from drivers.interfaces import DeviceIdentity, StreamHealth
from drivers.stream_buffer_and_repeats import StreamBuffer
from tacauchy_rig.core.config.settings import Checksum, RigConfig
from tacauchy_rig.core.errors import DeviceError
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


_logger = logging.getLogger(__name__)

PORT_ERRORS = (OSError, termios.error)
BITS_PER_BYTE = 10  # 8N1: start, eight, stop
FORMAT = "(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)"
_READ_TIMEOUT_S = 0.05
_WRITE_TIMEOUT_S = 0.5
_REPLY_TIMEOUT_S = 0.3
_QUIET_S = 0.1
_FIRST_FRAME_S = 0.5
_JOIN_TIMEOUT_S = 1.0
_QUOTED_BYTES = 16
_BUFFERED_S = 600.0


class SriM3733c:
    """A force/torque sensor that streams engineering units; see ``ForceTorqueSensor``.

    Samples with NaN or infinity are counted as corrupt and never delivered. Nothing reconnects by
    itself: after a failure make a new object.

    Args:
        config: Which port, and how the box is set; ``force_sensor.connect_timeout`` is from
            opening the port to the first valid frame. An emulated sensor is this one at its port,
            and one on a pseudo-terminal is recorded as simulated whatever the driver is called.
    """

    def __init__(self, config: RigConfig, _arm: object = None) -> None:
        sensor = self._sensor = config.force_sensor
        self._path = sensor.port
        self._port: serial.Serial | None = None
        self._parser = FrameParser(checksum=sensor.checksum)
        self._buffer = StreamBuffer[ForceSample](capacity=int(_BUFFERED_S * sensor.rate))
        self._stopping = threading.Event()
        self._reader: threading.Thread | None = None
        self._first_bytes = b""

    def connect(self) -> DeviceIdentity:
        """Open the port, configure the box, start the stream; see ``StreamingDevice``."""
        deadline = time.monotonic() + self._sensor.connect_timeout
        self._check_bandwidth()
        self._port = _open_port(self._path, baud_rate=self._sensor.baud_rate)
        try:
            settings = self._configure(self._port)
            self._reader = threading.Thread(
                target=self._read_forever, args=(self._port,), name="force-sensor", daemon=True
            )
            self._reader.start()
            self._port.write(encode_command("GSD"))
            left_s = max(deadline - time.monotonic(), _FIRST_FRAME_S)
            if not self._buffer.wait_for_first(timeout_s=left_s):
                raise self._no_frame()
        except PORT_ERRORS as error:
            self.close()
            raise _gone(self._path, error) from error
        except DeviceError:
            self.close()
            raise
        return DeviceIdentity(
            driver="m3733c",
            address=self._path,
            model="SRI M3733C, M8128-family box",
            serial=_adapter_serial(self._path),
            # A program, and no adapter, is behind a pseudo-terminal.
            simulated=self._sensor.is_emulated
            or os.path.realpath(self._path).startswith("/dev/pts/"),
            settings=settings,
        )

    def drain(self) -> list[ForceSample]:
        """Return every sample that arrived since the last call; see ``StreamingDevice``."""
        return self._buffer.drain()

    def health(self) -> StreamHealth:
        """Return counts, age and rate; ``repeat_count`` is the length of the present run."""
        return self._buffer.health(
            lost_count=self._parser.lost_count, corrupt_count=self._parser.corrupt_frame_count
        )

    def close(self) -> None:
        """Stop streaming and release the port. Safe to call twice."""
        self._stopping.set()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(_JOIN_TIMEOUT_S)
        port, self._port = self._port, None
        if port is None:
            return
        try:
            # Not flushed: waiting for a box that no longer reads could last for ever.
            port.write(encode_command("GSD", "STOP"))
        except PORT_ERRORS as error:
            _logger.debug("%s: could not stop the stream: %s", self._path, error)
        port.close()

    def _check_bandwidth(self) -> None:
        needed = self._sensor.rate * frame_length(self._sensor.checksum) * BITS_PER_BYTE
        if needed > 0.9 * self._sensor.baud_rate:
            raise DeviceError(
                f"force sensor: {self._sensor.rate:g} Hz needs {needed:.0f} baud; "
                f"{self._path} is set to {self._sensor.baud_rate}",
                remedy="lower force_sensor.rate or raise force_sensor.baud_rate (and the box's)",
            )

    def _configure(self, port: serial.Serial) -> dict[str, str]:
        """Stop whatever streams, set the box up, and return what was set and acknowledged."""
        self._silence(port)
        settings = {"baud_rate": str(self._sensor.baud_rate)}
        for names, value in (
            (("SMPF", "SMPR"), f"{self._sensor.rate:g}"),
            (("SGDM",), FORMAT),
            (("DCKMD",), self._sensor.checksum.value),
        ):
            name, acknowledged = self._set(port, names, value)
            settings[name] = value if acknowledged else f"{value} (not acknowledged)"
        return settings

    def _set(self, port: serial.Serial, names: tuple[str, ...], value: str) -> tuple[str, bool]:
        """Set a value under the first name that is acknowledged; return it and whether it was."""
        refused = False
        for name in names:
            reply = self._ask(port, name, value)
            if reply is not None and not reply.refused:
                return name, True
            refused = refused or reply is not None
        if refused:
            raise DeviceError(
                f"force sensor: the box on {self._path} refused {' and '.join(names)} = {value}",
                remedy="set force_sensor.rate and force_sensor.checksum to what its manual lists",
            )
        _logger.warning("%s: %s=%s was not acknowledged", self._path, names[0], value)
        return names[0], False

    def _silence(self, port: serial.Serial) -> None:
        """Stop a stream that an earlier owner left on; both spellings are in use."""
        for name in ("GSD", "GETSD"):
            port.write(encode_command(name, "STOP"))
            last_byte = started = time.monotonic()
            while (now := time.monotonic()) < started + _REPLY_TIMEOUT_S:
                if self._read_waiting(port):
                    last_byte = time.monotonic()
                elif now - last_byte > _QUIET_S:
                    return

    def _ask(self, port: serial.Serial, name: str, value: str) -> Reply | None:
        port.reset_input_buffer()
        port.write(encode_command(name, value))
        received = b""
        give_up = time.monotonic() + _REPLY_TIMEOUT_S
        while time.monotonic() < give_up:
            received += self._read_waiting(port)
            reply = find_reply(received, name=name)
            if reply is not None:
                return reply
        return None

    def _read_forever(self, port: serial.Serial) -> None:
        try:
            while not self._stopping.is_set():
                data, stamp_ns = self._read_waiting(port), time.monotonic_ns()
                for sample in self._parser.feed(data, stamp_ns=stamp_ns):
                    self._buffer.push(sample, stamp_ns=stamp_ns, fingerprint=sample.wrench)
        except PORT_ERRORS as error:
            self._buffer.fail(_gone(self._path, error))

    def _read_waiting(self, port: serial.Serial) -> bytes:
        """Wait for one byte for at most the port's timeout, then take all that waits with it."""
        data = bytes(port.read(1))
        if data:
            data += bytes(port.read(port.in_waiting))
        if len(self._first_bytes) < _QUOTED_BYTES:
            self._first_bytes += data[:_QUOTED_BYTES]
        return data

    def _no_frame(self) -> DeviceError:
        sensor = self._sensor
        if not self._first_bytes:
            return DeviceError(
                f"force sensor: {self._path} is silent: no byte in {sensor.connect_timeout:g} s",
                remedy=f"check the box's power, the cable, and that it is set to "
                f"{sensor.baud_rate} baud",
            )
        start = self._first_bytes[:_QUOTED_BYTES].hex(" ").upper()
        return DeviceError(
            f"force sensor: {self._path} sends something other than {sensor.checksum.value} frames "
            f"of six channels; it begins {start}",
            remedy="check force_sensor.baud_rate and force_sensor.checksum, and that this port is "
            "the sensor's box",
        )


def _gone(path: str, error: Exception) -> DeviceError:
    return DeviceError(
        f"force sensor: the port {path} is gone ({error})",
        remedy="check the USB cable and the box's power; nothing reconnects by itself",
    )


def _open_port(path: str, *, baud_rate: int) -> serial.Serial:
    """Open ``path`` exclusively, 8N1, and ask the adapter for low latency where it can."""
    holders = device_holders(path)
    if holders:
        raise _in_use(path, holders)
    try:
        port = serial.Serial(
            path,
            baudrate=baud_rate,
            timeout=_READ_TIMEOUT_S,
            write_timeout=_WRITE_TIMEOUT_S,
            exclusive=True,
        )
    except (OSError, ValueError) as error:
        raise explain_open_error(path, error) from error
    try:
        port.set_low_latency_mode(True)
    except (OSError, ValueError, NotImplementedError) as error:
        # Pseudo-terminals and some adapters refuse; doctor reports what the timer is.
        _logger.debug("%s: low latency mode not available: %s", path, error)
    return port


def explain_open_error(path: str, error: OSError | ValueError) -> DeviceError:
    """Turn the library's error into one that names the cause and the remedy."""
    code = error.errno if isinstance(error, OSError) else None
    text = str(error)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO):
        found = ", ".join(sorted(str(entry) for entry in Path("/dev/serial/by-id").glob("*")))
        is_there = "is there but nothing is behind it" if code != errno.ENOENT else "does not exist"
        return DeviceError(
            f"force sensor: the port {path} {is_there}",
            remedy="check the USB cable and the box's power; ports present now: "
            + (found or "none below /dev/serial/by-id"),
        )
    if code in (errno.EACCES, errno.EPERM):
        return DeviceError(
            f"force sensor: no permission to open {path}",
            remedy="sudo usermod -aG dialout $USER, then log out and in again",
        )
    if code == errno.EBUSY or "exclusively lock" in text:
        return _in_use(path, [])
    return DeviceError(
        f"force sensor: {path} cannot be used as a serial port: {text}",
        remedy="set force_sensor.port to the adapter's path below /dev/serial/by-id/",
    )


def _adapter_serial(path: str) -> str:
    """Return the USB serial number of the adapter behind ``path``, or an empty text."""
    target = os.path.realpath(path)
    for entry in list_ports.comports():
        if os.path.realpath(entry.device) == target:
            return str(entry.serial_number or "")
    return ""


def _in_use(path: str, holders: list[str]) -> DeviceError:
    who = ", ".join(holders) or "another program"
    return DeviceError(
        f"force sensor: {path} is in use by {who}",
        remedy=f"end that program; `fuser -v {path}` names it",
    )
