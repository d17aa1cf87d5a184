"""Start emulated devices as processes of their own and say where they answer."""

from __future__ import annotations

import ctypes
import json
import logging
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Self

from drivers.emulators.faults import Device
from tacauchy_rig.config.model import (
    CameraDriver,
    ForceSensorDriver,
    RigConfig,
    RobotDriver,
)
from tacauchy_rig.errors import DeviceError

logger = logging.getLogger(__name__)

UR_PORTS = (30004, 29999, 30003)
READY_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedAddresses:
    """Where the emulated devices answer; None for a device that is not emulated."""

    robot_host: str | None = None
    force_sensor_port: str | None = None
    camera_url: str | None = None


def emulated_devices(config: RigConfig) -> frozenset[Device]:
    """Return the devices whose driver is ``emulated``."""
    chosen = {
        Device.ROBOT: config.robot.driver is RobotDriver.EMULATED,
        Device.FORCE_SENSOR: config.force_sensor.driver is ForceSensorDriver.EMULATED,
        Device.CAMERA: config.camera.driver is CameraDriver.EMULATED,
    }
    return frozenset(device for device, emulated in chosen.items() if emulated)


def with_addresses(config: RigConfig, addresses: EmulatedAddresses) -> RigConfig:
    """Return the configuration with the emulated devices' addresses filled in."""
    changes: dict[str, Any] = {}
    if addresses.robot_host is not None:
        changes["robot"] = config.robot.model_copy(update={"host": addresses.robot_host})
    if addresses.force_sensor_port is not None:
        changes["force_sensor"] = config.force_sensor.model_copy(
            update={"port": addresses.force_sensor_port}
        )
    if addresses.camera_url is not None:
        changes["camera"] = config.camera.model_copy(update={"device": addresses.camera_url})
    return config.model_copy(update=changes)


def free_loopback_host(*, seed: int | None = None) -> str:
    """Return a loopback address whose three controller ports are free.

    ur_rtde fixes the ports, so each emulated controller needs an address of its own.

    Raises:
        DeviceError: No free address was found in 200 tries.
    """
    source = random.Random(seed)  # noqa: S311 - an address, not a secret
    for _ in range(200):
        host = f"127.{source.randint(1, 250)}.{source.randint(1, 250)}.{source.randint(2, 250)}"
        if all(_port_is_free(host, port) for port in UR_PORTS):
            return host
    raise DeviceError(
        "emulated robot: no loopback address has ports 30004, 29999 and 30003 free",
        remedy="end other emulators, or set emulation.robot_host",
    )


def _port_is_free(host: str, port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True


class EmulatedProcess:
    """One emulator: a child process that prints a JSON line when it is ready."""

    def __init__(self, name: str, arguments: list[str], *, folder: Path) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        self._lines: Queue[str] = Queue()
        threading.Thread(target=self._read_lines, daemon=True).start()

    def _read_lines(self) -> None:
        stream = self.process.stdout
        if stream is None:
            return
        for line in stream:
            self._lines.put(line.decode(errors="replace"))

    def wait_ready(self, *, timeout_s: float = READY_TIMEOUT_S) -> dict[str, Any]:
        """Return the emulator's ready line.

        Raises:
            DeviceError: It ended, or said nothing before the deadline.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            try:
                return dict(json.loads(self._lines.get(timeout=0.1)))
            except Empty:
                if self.process.poll() is not None:
                    break
            except ValueError:
                continue
        raise DeviceError(
            f"emulated {self.name}: not ready within {timeout_s:g} s "
            f"(exit status {self.process.poll()}): {self._log_tail()}",
            remedy=f"read {self.log}",
        )

    def _log_tail(self) -> str:
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it printed no error"

    def stop(self) -> None:
        """Ask it to end; kill it if it does not."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(timeout=3.0)
            except subprocess.TimeoutExpired:
                logger.warning("emulated %s did not end; killing it", self.name)
                self.process.kill()
                self.process.wait()


def _die_with_parent() -> None:
    """Ask the kernel to end this process with its parent (Linux prctl PR_SET_PDEATHSIG)."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)


class Emulation:
    """The emulated part of a rig, running.

    Args:
        config: The rig; its emulation seed decides the emulated world.
        folder: Where control sockets, traces and logs go.
        devices: What to emulate.
        follow_host: A robot that is not emulated here, whose reported pose moves the indenter of
            the emulated world; needed when a sensor or camera is emulated and the robot is not.
    """

    def __init__(
        self,
        config: RigConfig,
        *,
        folder: Path,
        devices: frozenset[Device],
        follow_host: str | None = None,
    ) -> None:
        self.config = config
        self.folder = folder.resolve()
        self.devices = devices
        self.follow_host = follow_host
        self.processes: dict[str, EmulatedProcess] = {}
        self.addresses = EmulatedAddresses()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def world_path(self) -> Path:
        """The memory-mapped file through which the emulators share the arm's state."""
        return self.folder / "world"

    def stop(self) -> None:
        """End every emulator."""
        for process in self.processes.values():
            process.stop()

    def start(self) -> EmulatedAddresses:
        """Start every emulator and return where they answer.

        Raises:
            DeviceError: One of them did not come up; the others are ended again.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            self.addresses = self._start_all()
        except DeviceError:
            self.stop()
            raise
        return self.addresses
