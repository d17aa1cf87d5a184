"""An emulated M8128-family box as a process.

It prints one JSON line with the path of its port when that can be opened, and continues
``force_trace.jsonl``: for each frame its number, moment, true force and true depth.
"""

import json
import logging
import math
import os
import pty
import random
import select
import sys
import time
import tty
from pathlib import Path
from typing import TextIO

import numpy as np

from drivers.emulators.faults import Device, FaultKind, FaultyLine, SilentWrenchFaults
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.process import DeviceSettings, Service, keep_time, run_device
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from drivers.force_sensor import sri_m3733c
from tacauchy_rig.core.config.settings import Checksum
from tacauchy_rig.core.known_weight import GRAVITY_M_S2
from tacauchy_rig.core.rotations import rotated
from tacauchy_rig.core.run import Vector3, Vector6

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
        self.is_open = True
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""
        except OSError:  # EIO: nobody has the other end open
            self.is_open = False
            return b""

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


class EmulatedBox:
    """The box's loop: commands in, frames out at the moments they are due."""

    def __init__(
        self, settings: DeviceSettings, service: Service, port: PseudoPort, trace: TextIO
    ) -> None:
        self._service, self._port, self._trace = service, port, trace
        sensor, plant = settings.config.force_sensor, plant_of(settings)
        seed = settings.config.emulation.seed
        world = SharedWorld.create(settings.folder / WORLD_FILE)
        self._source = WrenchSource(plant, world, compression_sign=sensor.compression_sign)
        self._commands = BoxCommands(rate_hz=round(sensor.rate), quirks=settings.quirks)
        self._silent = SilentWrenchFaults(seed=seed, full_scale_n=sensor.capacity)
        self._line = FaultyLine(seed, _garbled)  # of frames that wait for their moment to leave
        # From the moment that a frame belongs to until it leaves.
        self._latency_ns = round(plant.truth.force_latency_s * 1e9)
        self._number = -1  # package number of the newest frame; it advances in every fault
        self._due_ns = time.monotonic_ns()
        self._rate_hz = self._commands.rate_hz

    def run(self) -> None:
        """Serve until stopped, or left behind by the parent process."""
        self._due_ns = time.monotonic_ns() + self._period_ns
        while not self._service.is_over:
            self._wait()
            now_ns = time.monotonic_ns()
            kinds = {fault.kind for fault in self._service.faults_at(now_ns * 1e-9)}
            if (FaultKind.UNPLUG in kinds) is self._port.is_plugged:
                _logger.info("unplugged" if self._port.is_plugged else "plugged in")
                (self._port.unplug if self._port.is_plugged else self._port.plug_in)()
            data = self._port.read()
            if data and FaultKind.STALL not in kinds:
                self._answer(data, now_ns)
            self._send_due(now_ns)

    def _answer(self, data: bytes, now_ns: int) -> None:
        self._port.write(self._commands.receive(data))
        if self._commands.rate_hz != self._rate_hz:
            self._rate_hz = self._commands.rate_hz
            self._due_ns = now_ns + self._period_ns

    @property
    def _period_ns(self) -> int:
        return round(1e9 / self._rate_hz)

    def _wait(self) -> None:
        wake_ns = min(self._due_ns, self._line.next_due_ns or self._due_ns)
        timeout_s = max(wake_ns - time.monotonic_ns(), 0) * 1e-9
        # A port that nobody has open would always be readable: wait for the clock alone then.
        watched: list[PseudoPort | Service] = [self._service]
        if self._port.is_open:
            watched.append(self._port)
        select.select(watched, [], [], timeout_s)

    def _send_due(self, now_ns: int) -> None:
        if now_ns - self._due_ns > _BACKLOG_LIMIT_NS:
            missed = (now_ns - self._due_ns) // self._period_ns
            self._number += missed
            self._due_ns += missed * self._period_ns
        while self._due_ns <= now_ns:
            self._make_frame(self._due_ns)
            self._due_ns += self._period_ns
        self._port.write(b"".join(self._line.due(now_ns)))

    def _make_frame(self, stamp_ns: int) -> None:
        if not self._commands.streaming:
            return
        reading, force_n, depth_m = self._source.read(stamp_ns, hung_kg=self._service.hung_kg)
        self._number += 1
        active = {fault.kind: fault for fault in self._service.faults_at(stamp_ns * 1e-9)}
        values = self._silent.reading(reading, active.values(), stamp_ns=stamp_ns)
        data = sri_m3733c.encode_frame(self._number, values, checksum=self._commands.checksum)
        self._line.put(data, active, due_ns=stamp_ns + self._latency_ns)
        record = {
            "number": self._number,
            "stamp_ns": stamp_ns,
            "force_true_n": round(force_n, 6),
            "depth_true_m": None if depth_m is None else round(depth_m, 9),
        }
        self._trace.write(json.dumps(record) + "\n")


def _garbled(data: bytes, source: random.Random) -> bytes:
    damaged = bytearray(data)
    for _ in range(3):
        damaged[source.randrange(len(damaged))] ^= source.randrange(1, 256)
    return bytes(damaged)


LINK_NAME = "force_sensor.port"


def _serve(settings: DeviceSettings, service: Service) -> None:
    link = settings.folder / LINK_NAME
    with open_trace(settings.folder / TRACE_FILE) as trace:
        port = PseudoPort(link)
        box = EmulatedBox(settings, service, port, trace)
        service.announce(port=port.path, link=str(link))
        keep_time(mostly_sleeps=True)
        box.run()
        port.unplug()


MAX_RATE_HZ = 2000
_LINE_LIMIT = 1024


class BoxCommands:
    """Settings of the box and the commands that change them."""

    def __init__(self, *, rate_hz: int = 100, quirks: frozenset[str] = frozenset()) -> None:
        self.rate_hz = rate_hz
        self.checksum = Checksum.SUM
        # Whether frames go out by themselves; a box keeps on when its port is closed.
        self.streaming = False
        self._format = ""
        self._rate_command = "SMPR" if "smpr" in quirks else "SMPF"
        self._quirks = quirks
        self._line = b""

    def receive(self, data: bytes) -> bytes:
        """Take bytes from the host and return the replies to the lines that they complete."""
        *lines, rest = (self._line + data).split(sri_m3733c.LINE_END)
        self._line = rest[-_LINE_LIMIT:]
        return b"".join(self._answer(line) for line in lines)

    def _answer(self, line: bytes) -> bytes:
        command = sri_m3733c.decode_command(line)
        reply = None if command is None else self._execute(*command)
        if "silent" in self._quirks or reply is None:
            return b""
        data = sri_m3733c.encode_reply(reply)
        return data.replace(b"$", b"") if "bare" in self._quirks else data

    def _execute(self, name: str, value: str | None) -> sri_m3733c.Reply:
        value = value or ""
        if value == "?":
            known = {
                self._rate_command: str(self.rate_hz),
                "DCKMD": self.checksum.value,
                "SGDM": self._format,
            }
            return sri_m3733c.Reply(name, known.get(name, ""), refused=name not in known)
        if name == "GSD":
            self.streaming = value != "STOP"
        elif name == self._rate_command and value.isdecimal() and 0 < int(value) <= MAX_RATE_HZ:
            self.rate_hz = int(value)
        elif name == "DCKMD" and value in set(Checksum):
            self.checksum = Checksum(value)
        elif name == "SGDM" and value.startswith("(A01,A02,A03,A04,A05,A06);E;1;"):
            self._format = value
        else:
            return sri_m3733c.Reply(name, value, refused=True)
        return sri_m3733c.Reply(name, value)


class ForceChannel:
    """Offset, drift, cross talk and noise of one sensor, in its own frame.

    Its frame is the tool's, turned by half a turn about x where its Fz is positive while the
    indenter is pressed.

    Args:
        compression_sign: 1 where it is mounted like that, -1 where it is mounted as the tool is.
    """

    def __init__(self, truth: PlantTruth, *, start_ns: int, compression_sign: int = 1) -> None:
        self._truth = truth
        self._sign = -compression_sign
        self._start_ns = start_ns
        self._noise = np.random.default_rng([truth.seed, 1])

    def reading(
        self, force: Vector3, torque: Vector3, rotation_vector: Vector3, stamp_ns: int
    ) -> Vector6:
        """Return Fx, Fy, Fz [N], Mx, My, Mz [N m] as the sensor reports them.

        Args:
            force: On the indenter, in the base frame [N].
            torque: On the indenter about the tip, in the base frame [N m].
            rotation_vector: Orientation of the tool in the base frame [rad].
            stamp_ns: When; drift counts from the channel's start.
        """
        truth = self._truth
        x, y, z = rotation_vector
        back = (-x, -y, -z)
        (fx, fy, fz), (mx, my, mz) = rotated(force, back), rotated(torque, back)
        fy, fz, my, mz = (self._sign * value for value in (fy, fz, my, mz))
        drift = truth.force_drift_n_s * (stamp_ns - self._start_ns) * 1e-9
        f_noise = (truth.force_noise_n * self._noise.standard_normal(3)).tolist()
        m_noise = (truth.torque_noise_nm * self._noise.standard_normal(3)).tolist()
        offset, talk = truth.force_offset_n, truth.cross_talk
        return (
            fx + talk[0] * fz + offset[0] + f_noise[0],
            fy + talk[1] * fz + offset[1] + f_noise[1],
            fz + offset[2] + drift + f_noise[2],
            mx + m_noise[0],
            my + m_noise[1],
            mz + m_noise[2],
        )


_DOWN: Vector3 = (0.0, math.pi, 0.0)  # how a tool hangs
TRACE_FILE = "force_trace.jsonl"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def open_trace(path: Path, *, boot_id: str | None = None) -> TextIO:
    """Open the trace for more lines; the first line names the boot that its stamps belong to."""
    first = json.dumps({"boot_id": boot_id or BOOT_ID.read_text("ascii").strip()}) + "\n"
    before = path.read_text("utf-8") if path.is_file() else ""
    if not before.startswith(first):
        path.write_text(first, encoding="utf-8")
        before = first
    trace = path.open("a", buffering=1, encoding="utf-8")
    if not before.endswith("\n"):
        trace.write("\n")  # a kill has torn the last line
    return trace


class WrenchSource:
    """The force on the indenter as the gel, the arm's pose and the sensor's electronics make it.

    Until an arm has published a pose, the sensor hangs free.
    """

    def __init__(self, plant: Plant, world: SharedWorld, *, compression_sign: int) -> None:
        self._channel = ForceChannel(
            plant.truth, start_ns=time.monotonic_ns(), compression_sign=compression_sign
        )
        self._plant, self._world = plant, world

    def read(self, stamp_ns: int, *, hung_kg: float = 0.0) -> tuple[Vector6, float, float | None]:
        """Read for the newest pose of the arm; a weight pulls straight down.

        Returns:
            Fx, Fy, Fz [N], Mx, My, Mz [N m] with noise, drift and cross talk; the true pressing
            force [N]; depth of the tip below the unloaded surface [m], negative above it and None
            where there is no gel under it.
        """
        rotation_vector, depth = _DOWN, -math.inf
        force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        state = self._world.read()
        if state.sequence > 0:
            rotation_vector = state.pose.rotation_vector
            force, torque = self._plant.wrench(state.pose, stamp_ns)
            depth = self._plant.depth(state.pose)
        load = (force[0], force[1], force[2] - hung_kg * GRAVITY_M_S2)
        reading = self._channel.reading(load, torque, rotation_vector, stamp_ns)
        return reading, force[2], depth if math.isfinite(depth) else None


if __name__ == "__main__":
    sys.exit(run_device(Device.FORCE_SENSOR, _serve))
