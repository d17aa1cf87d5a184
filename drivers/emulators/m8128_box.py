"""An emulated M8128-family box: a process that serves a pseudo-terminal as a serial port.

It streams on absolute deadlines, keeps counting while nobody listens, serves every client that
opens the port anew, and writes ``force_trace.jsonl`` with the truth behind each frame.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import pty
import select
import signal
import sys
import time
import tty
from pathlib import Path
from types import FrameType
from typing import TextIO

from drivers.emulators.faults import Device, Fault, FaultInbox, FaultKind, FaultSchedule
from drivers.emulators.m8128_protocol import BoxCommands, ReplyStyle
from drivers.emulators.m8128_source import ConstantSource, WrenchSource
from drivers.emulators.m8128_stream import FrameStream
from tacauchy_rig.errors import RigError
from tacauchy_rig.run import Vector6

_logger = logging.getLogger(__name__)

TRACE_FILE = "force_trace.jsonl"
LINK_NAME = "force_sensor.port"
_BACKLOG_LIMIT_NS = 500_000_000
_FLUSH_FRAMES = 100


class PseudoPort:
    """The device end of a pseudo-terminal; the other end looks like a serial port."""

    def __init__(self, link: Path) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._link = link
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(self.path)
        self.is_open = False

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._master

    def read(self) -> bytes:
        """Return what the client has sent; notes whether one has the port open."""
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            self.is_open = True
            return b""
        except OSError:  # EIO: nobody has the other end open
            self.is_open = False
            return b""
        self.is_open = True
        return data

    def write(self, data: bytes) -> None:
        """Send to the client; what does not fit or has no listener is gone, as on a wire."""
        if not (self.is_open and data):
            return
        try:
            os.write(self._master, data)
        except OSError as error:
            _logger.debug("%d bytes dropped: %s", len(data), error)

    def close(self) -> None:
        """Pull the plug: the client's next read fails."""
        os.close(self._master)
        self._link.unlink(missing_ok=True)


class EmulatedBox:
    """The box's loop: commands in, frames out at the moments they are due."""

    def __init__(
        self,
        port: PseudoPort,
        inbox: FaultInbox,
        *,
        commands: BoxCommands,
        stream: FrameStream,
        source: WrenchSource,
        trace: TextIO,
    ) -> None:
        self._port = port
        self._inbox = inbox
        self._commands = commands
        self._stream = stream
        self._source = source
        self._trace = trace
        self._schedule = FaultSchedule()
        self._zero: Vector6 = (0.0,) * 6
        self._due_ns = time.monotonic_ns()
        self._rate_hz = commands.rate_hz
        self.stopping = False

    def run(self) -> None:
        """Serve until stopped or unplugged."""
        self._due_ns = time.monotonic_ns() + self._period_ns
        while not self.stopping:
            self._wait()
            now_ns = time.monotonic_ns()
            for fault in self._inbox.poll():
                self.add_fault(fault, now_ns=now_ns)
            self._answer(self._port.read(), now_ns)
            if self._has(FaultKind.UNPLUG, now_ns):
                _logger.info("unplugged")
                return
            self._send_due(now_ns)

    def add_fault(self, fault: Fault, *, now_ns: int) -> None:
        """Take in a fault, its start counted from ``now_ns``."""
        _logger.info("fault: %s", fault)
        self._schedule.add(fault, now_s=now_ns * 1e-9)

    def _has(self, kind: FaultKind, now_ns: int) -> bool:
        return any(fault.kind is kind for fault in self._schedule.active(now_ns * 1e-9))

    def _answer(self, data: bytes, now_ns: int) -> None:
        if not data or self._has(FaultKind.STALL, now_ns):
            return
        self._port.write(self._commands.receive(data))
        if self._commands.rate_hz != self._rate_hz:
            self._rate_hz = self._commands.rate_hz
            self._due_ns = now_ns + self._period_ns

    @property
    def _period_ns(self) -> int:
        return round(1e9 / self._rate_hz)

    def _wait(self) -> None:
        timeout_s = max(self._due_ns - time.monotonic_ns(), 0) * 1e-9
        # A port that nobody has open would always be readable: wait for the clock alone then.
        watched: list[PseudoPort | FaultInbox] = [self._inbox]
        if self._port.is_open:
            watched.append(self._port)
        select.select(watched, [], [], timeout_s)

    def _send_due(self, now_ns: int) -> None:
        if now_ns - self._due_ns > _BACKLOG_LIMIT_NS:
            missed = (now_ns - self._due_ns) // self._period_ns
            self._stream.number += missed
            self._due_ns += missed * self._period_ns
        while self._due_ns <= now_ns:
            self._make_frame(self._due_ns)
            self._due_ns += self._period_ns
        self._port.write(self._stream.due(now_ns))

    def _make_frame(self, stamp_ns: int) -> None:
        if not self._commands.streaming and not self._commands.single_count:
            return
        self._commands.single_count = max(self._commands.single_count - 1, 0)
        force = self._source.read(stamp_ns)
        if self._commands.zero_requested:
            self._zero, self._commands.zero_requested = force.reading, False
        v = [value - zero for value, zero in zip(force.reading, self._zero, strict=True)]
        self._stream.next_frame(
            (v[0], v[1], v[2], v[3], v[4], v[5]),
            stamp_ns=stamp_ns,
            faults=self._schedule.active(stamp_ns * 1e-9),
            checksum=self._commands.checksum,
        )
        record = {
            "number": self._stream.number,
            "stamp_ns": stamp_ns,
            "force_true_n": round(force.force_true_n, 6),
            "depth_true_m": round(force.depth_true_m, 9),
        }
        self._trace.write(json.dumps(record) + "\n")
        if self._stream.number % _FLUSH_FRAMES == 0:
            self._trace.flush()


def main(arguments: list[str] | None = None) -> int:
    """Run the emulator as a process; prints one JSON line when the port can be opened."""
    options = _parse(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    folder: Path = options.folder
    try:
        source = _source(options)
        inbox = FaultInbox(folder, Device.FORCE_SENSOR)
        port = PseudoPort(folder / LINK_NAME)
        with (folder / TRACE_FILE).open("w", encoding="utf-8") as trace:
            box = EmulatedBox(
                port,
                inbox,
                commands=BoxCommands(
                    rate_hz=options.rate,
                    rate_command=options.rate_command,
                    style=ReplyStyle(options.replies),
                ),
                stream=FrameStream(seed=options.seed, full_scale_n=options.full_scale_n),
                source=source,
                trace=trace,
            )
            _stop_on_signals(box)
            ready = {"device": "force_sensor", "port": port.path, "link": str(folder / LINK_NAME)}
            print(json.dumps({**ready, "pid": os.getpid()}), flush=True)
            box.run()
            port.close()
            inbox.close()
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def _stop_on_signals(box: EmulatedBox) -> None:
    def stop(_number: int, _frame: FrameType | None) -> None:
        box.stopping = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)


def _source(options: argparse.Namespace) -> WrenchSource:
    v = [float(text) for text in options.load.split(",")]
    return ConstantSource(
        (v[0], v[1], v[2], v[3], v[4], v[5]), noise_n=options.noise_n, seed=options.seed
    )


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="m8128_box", description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="sockets, trace and link")
    parser.add_argument("--world", type=Path, help="shared world file; without it a constant load")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--rate", type=int, default=100, help="frames per second until told else")
    parser.add_argument("--full-scale-n", type=float, default=50.0, help="Fz when saturated [N]")
    parser.add_argument(
        "--replies",
        choices=[style.value for style in ReplyStyle],
        default=ReplyStyle.DOLLAR_OK.value,
    )
    parser.add_argument("--rate-command", choices=["SMPF", "SMPR"], default="SMPF")
    parser.add_argument("--load", default="0,0,0,0,0,0", help="constant load [N, N m]")
    parser.add_argument("--noise-n", type=float, default=0.002, help="noise of a constant load [N]")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
