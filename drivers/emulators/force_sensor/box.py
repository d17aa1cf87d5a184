"""An emulated M8128-family box as a process: ``python -m drivers.emulators.force_sensor.box``.

It prints one JSON line with the path of its port when that can be opened, and continues
``force_trace.jsonl``: for each frame its number, moment, true force and true depth.
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

from drivers.device.faults import Device, Fault, FaultKind
from drivers.emulators.faults import FaultInbox, FaultSchedule
from drivers.emulators.force_sensor.protocol import BoxCommands, FrameStream, ReplyStyle
from drivers.emulators.force_sensor.source import (
    TRACE_FILE,
    ConstantSource,
    ForceChannel,
    PlantSource,
    WrenchSource,
    open_trace,
)
from drivers.emulators.plant.arguments import add_plant_arguments, plant_from_arguments
from drivers.emulators.plant.gel import Plant
from drivers.emulators.process import keep_time
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.errors import RigError
from tacauchy_rig.run import Vector6

_logger = logging.getLogger(__name__)


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


_BACKLOG_LIMIT_NS = 500_000_000
_FLUSH_FRAMES = 100


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
        parent_pid: int | None = None,
    ) -> None:
        self._port = port
        self._inbox = inbox
        self._commands = commands
        self._stream = stream
        self._source = source
        self._trace = trace
        self._parent_pid = parent_pid
        self._schedule = FaultSchedule()
        self._zero: Vector6 = (0.0,) * 6
        self._due_ns = time.monotonic_ns()
        self._rate_hz = commands.rate_hz
        self.stopping = False

    def run(self) -> None:
        """Serve until stopped, unplugged, or left behind by the parent process."""
        self._due_ns = time.monotonic_ns() + self._period_ns
        while not self.stopping and self._parent_pid in (None, os.getppid()):
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
        wake_ns = min(self._due_ns, self._stream.next_due_ns or self._due_ns)
        timeout_s = max(wake_ns - time.monotonic_ns(), 0) * 1e-9
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
            "depth_true_m": None if force.depth_true_m is None else round(force.depth_true_m, 9),
        }
        self._trace.write(json.dumps(record) + "\n")
        if self._stream.number % _FLUSH_FRAMES == 0:
            self._trace.flush()


LINK_NAME = "force_sensor.port"


def main(arguments: list[str] | None = None) -> int:
    """Run the emulator as a process; prints one JSON line when the port can be opened."""
    options = _parse(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    options.folder.mkdir(parents=True, exist_ok=True)
    try:
        _serve(options)
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def _serve(options: argparse.Namespace) -> None:
    folder: Path = options.folder
    source = _constant_source(options)
    latency_s = 0.0
    if options.world is not None:
        plant = plant_from_arguments(options)
        source, latency_s = _plant_source(options, plant), plant.truth.force_latency_s
    inbox = FaultInbox(folder, Device.FORCE_SENSOR)
    port = PseudoPort(folder / LINK_NAME)
    with open_trace(folder / TRACE_FILE) as trace:
        box = EmulatedBox(
            port,
            inbox,
            commands=BoxCommands(
                rate_hz=options.rate,
                rate_command=options.rate_command,
                style=ReplyStyle(options.replies),
            ),
            stream=FrameStream(
                seed=options.seed, full_scale_n=options.full_scale_n, latency_s=latency_s
            ),
            source=source,
            trace=trace,
            parent_pid=options.parent_pid,
        )
        _stop_on_signals(box)
        ready = {"device": "force_sensor", "port": port.path, "link": str(folder / LINK_NAME)}
        print(json.dumps({**ready, "pid": os.getpid()}), flush=True)
        keep_time(mostly_sleeps=True)
        box.run()
        port.close()
        inbox.close()


def _stop_on_signals(box: EmulatedBox) -> None:
    def stop(_number: int, _frame: FrameType | None) -> None:
        box.stopping = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)


def _constant_source(options: argparse.Namespace) -> WrenchSource:
    v = [float(part) for part in options.load.split(",")]
    return ConstantSource(
        (v[0], v[1], v[2], v[3], v[4], v[5]), noise_n=options.noise_n, seed=options.seed
    )


def _plant_source(options: argparse.Namespace, plant: Plant) -> WrenchSource:
    channel = ForceChannel(plant.truth, start_ns=time.monotonic_ns())
    return PlantSource(plant, channel, SharedWorld.create(options.world))


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="m8128_box", description=__doc__)
    add_plant_arguments(parser)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="where control socket, trace and link go")
    add("--world", type=Path, help="shared world file; without it the load is constant")
    add("--rate", type=int, default=100, help="frames per second until a client sets another")
    add("--full-scale-n", type=float, default=50.0, help="what Fz reads when saturated [N]")
    add("--rate-command", choices=["SMPF", "SMPR"], default="SMPF")
    add("--replies", choices=[style.value for style in ReplyStyle], default="dollar-ok")
    add("--load", default="0,0,0,0,0,0", help="constant load [N, N m]")
    add("--noise-n", type=float, default=0.002, help="noise of the constant load [N]")
    add("--parent-pid", type=int, help="end when this parent process ends")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
