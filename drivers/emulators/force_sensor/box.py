"""An emulated M8128-family box as a process: ``python -m drivers.emulators.force_sensor.box``.

It prints one JSON line with the path of its port when that can be opened, and continues
``force_trace.jsonl``: for each frame its number, moment, true force and true depth.
"""

from __future__ import annotations

import json
import logging
import os
import pty
import select
import sys
import time
import tty
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TextIO

from drivers.device.faults import Device, FaultKind
from drivers.emulators.force_sensor.protocol import BoxCommands, FrameStream, ReplyStyle
from drivers.emulators.force_sensor.source import (
    TRACE_FILE,
    ConstantSource,
    ForceChannel,
    PlantSource,
    WrenchSource,
    open_trace,
)
from drivers.emulators.gel_settings import GelSettings
from drivers.emulators.process import Service, keep_time, run_device
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.core.run import Vector6

_logger = logging.getLogger(__name__)


class PseudoPort:
    """The device end of a pseudo-terminal; the other end looks like a serial port."""

    def __init__(self, link: Path) -> None:
        self._link = link
        self.is_open = False
        self.is_plugged = False
        self.plug_in()

    def plug_in(self) -> None:
        """Be there for clients, at the same link as before."""
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(self.path)
        self.is_plugged = True

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._master

    def read(self) -> bytes:
        """Return what the client has sent; notes whether one has the port open."""
        if not self.is_plugged:
            return b""
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

    def unplug(self) -> None:
        """Pull the plug: the client's next read fails. Safe to call twice."""
        if self.is_plugged:
            os.close(self._master)
            self._link.unlink(missing_ok=True)
        self.is_open = self.is_plugged = False


_BACKLOG_LIMIT_NS = 500_000_000
_FLUSH_FRAMES = 100


class EmulatedBox:
    """The box's loop: commands in, frames out at the moments they are due."""

    def __init__(
        self, settings: BoxSettings, service: Service, port: PseudoPort, trace: TextIO
    ) -> None:
        self._service = service
        self._port = port
        self._trace = trace
        self._source: WrenchSource = ConstantSource(
            settings.load,
            noise_n=settings.noise_n,
            seed=settings.seed,
            compression_sign=settings.compression_sign,
        )
        latency_s = 0.0
        if settings.world is not None:
            plant = settings.plant()
            channel = ForceChannel(
                plant.truth,
                start_ns=time.monotonic_ns(),
                compression_sign=settings.compression_sign,
            )
            self._source = PlantSource(plant, channel, SharedWorld.create(settings.world))
            latency_s = plant.truth.force_latency_s
        self._commands = BoxCommands(
            rate_hz=settings.rate, rate_command=settings.rate_command, style=settings.replies
        )
        self._stream = FrameStream(
            seed=settings.seed, full_scale_n=settings.full_scale_n, latency_s=latency_s
        )
        self._zero: Vector6 = (0.0,) * 6
        self._due_ns = time.monotonic_ns()
        self._rate_hz = settings.rate

    def run(self) -> None:
        """Serve until stopped, or left behind by the parent process."""
        self._due_ns = time.monotonic_ns() + self._period_ns
        while not self._service.is_over:
            self._wait()
            now_ns = time.monotonic_ns()
            self._plug(now_ns)
            self._answer(self._port.read(), now_ns)
            self._send_due(now_ns)

    def _plug(self, now_ns: int) -> None:
        plugged = not self._has(FaultKind.UNPLUG, now_ns)
        if plugged != self._port.is_plugged:
            _logger.info("plugged in" if plugged else "unplugged")
            (self._port.plug_in if plugged else self._port.unplug)()

    def _has(self, kind: FaultKind, now_ns: int) -> bool:
        return any(fault.kind is kind for fault in self._service.faults_at(now_ns * 1e-9))

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
        watched: list[PseudoPort | Service] = [self._service]
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
        force = self._source.read(stamp_ns, hung_kg=self._service.hung_kg)
        if self._commands.zero_requested:
            self._zero, self._commands.zero_requested = force.reading, False
        v = [value - zero for value, zero in zip(force.reading, self._zero, strict=True)]
        self._stream.next_frame(
            (v[0], v[1], v[2], v[3], v[4], v[5]),
            stamp_ns=stamp_ns,
            faults=self._service.faults_at(stamp_ns * 1e-9),
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


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxSettings(GelSettings):
    """How one emulated M8128-family box is set up; serial clients open its pseudo-terminal.

    Without a world its load is constant.

    Attributes:
        rate: Frames per second until a client sets another.
        full_scale_n: What Fz reads when saturated [N].
        compression_sign: 1 where raw Fz is positive while the indenter is pressed, else -1.
        rate_command: SMPF or SMPR.
        replies: How it ends them: dollar-ok, bare-ok or silent.
        load: Constant load Fx,Fy,Fz,Mx,My,Mz [N, N m].
        noise_n: Noise of the constant load [N].
    """

    rate: int = 100
    full_scale_n: float = 50.0
    compression_sign: int = 1
    rate_command: Literal["SMPF", "SMPR"] = "SMPF"
    replies: ReplyStyle = ReplyStyle.DOLLAR_OK
    load: Vector6 = (0.0,) * 6
    noise_n: float = 0.002


def _serve(settings: BoxSettings, service: Service) -> None:
    link = settings.folder / LINK_NAME
    with open_trace(settings.folder / TRACE_FILE) as trace:
        port = PseudoPort(link)
        box = EmulatedBox(settings, service, port, trace)
        service.announce(port=port.path, link=str(link))
        keep_time(mostly_sleeps=True)
        box.run()
        port.unplug()


if __name__ == "__main__":
    sys.exit(run_device(BoxSettings, Device.FORCE_SENSOR, _serve))
