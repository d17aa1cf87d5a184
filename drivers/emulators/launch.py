"""Start emulated devices as processes of their own and say where they answer."""

from __future__ import annotations

import logging
import os
import random
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from drivers.emulators.camera.frame_server import VIDEO_DEVICE, preloaded
from drivers.emulators.faults import Device, parse_fault
from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.truth import EmulatedUnit, draw_truth, write_truth
from drivers.emulators.process import DeviceSettings, EmulatedProcess, post_fault
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Vector3

logger = logging.getLogger(__name__)

UR_PORTS = (30004, 29999, 30003)


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedAddresses:
    """Where the emulated devices answer; None for a device that is not emulated.

    A camera that is played through V4L2 has the path of its device for a URL.
    """

    robot_host: str | None = None
    force_sensor_port: str | None = None
    camera_url: str | None = None


def emulated_devices(config: RigConfig) -> frozenset[Device]:
    """Return the devices whose driver is ``emulated``."""
    return frozenset(each for each in Device if getattr(config, each.value).is_emulated)


def with_addresses(config: RigConfig, addresses: EmulatedAddresses) -> RigConfig:
    """Return the configuration with the emulated devices' addresses filled in."""
    places = {
        "robot": ("host", addresses.robot_host),
        "force_sensor": ("port", addresses.force_sensor_port),
        "camera": ("device", addresses.camera_url),
    }
    changes = {
        device: getattr(config, device).model_copy(update={field: place})
        for device, (field, place) in places.items()
        if place is not None
    }
    return config.model_copy(update=changes)


def free_loopback_host() -> str:
    """Return a loopback address whose three controller ports are free.

    ur_rtde fixes the ports, so each emulated controller needs an address of its own.
    """
    source = random.Random()  # noqa: S311 - an address, not a secret
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


class Emulation:
    """The emulated part of a rig, running.

    Args:
        follow_host: A robot that is not emulated here, whose reported pose moves the indenter of
            the emulated world; needed when a sensor or camera is emulated and the robot is not.
        unit: The make of sensor that is emulated; a GelSight Mini if None.
    """

    def __init__(
        self,
        config: RigConfig,
        *,
        folder: Path,
        devices: frozenset[Device],
        camera_host: str = "127.0.0.1",
        camera_port: int = 0,
        follow_host: str | None = None,
        unit: EmulatedUnit | None = None,
    ) -> None:
        self.config = config
        self.camera_host, self.camera_port = camera_host, camera_port
        self.folder = folder.resolve()
        self.devices = devices
        self.follow_host = follow_host
        self.unit = unit or EmulatedUnit()
        self.processes: dict[str, EmulatedProcess] = {}
        self._robot_host = ""
        self.addresses = EmulatedAddresses()
        self.preloaded: dict[str, str] = {}
        self._environment: dict[str, str] = {}

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def world_path(self) -> Path:
        """The memory-mapped file through which the emulators share the arm's state."""
        return self.folder / WORLD_FILE

    def stop(self) -> None:
        """End every emulator."""
        for process in self.processes.values():
            process.stop()
        for name in self.preloaded:
            os.environ.pop(name, None)
        os.environ.update(self._environment)
        self.preloaded, self._environment = {}, {}

    def start(self) -> EmulatedAddresses:
        """Start every emulator and return where they answer.

        Raises:
            DeviceError: One of them did not come up; the others are ended again.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        asked = self.config.emulation
        truth = draw_truth(asked.seed, unit=self.unit, friction=asked.friction, tilt_rad=asked.tilt)
        write_truth(self.folder, truth)
        self.gel()  # its table is made here once: that may take longer than a device's coming up
        SharedWorld.create(self.world_path).close()
        if Device.ROBOT in self.devices:
            self._robot_host = asked.robot_host
            if self._robot_host == "auto":
                self._robot_host = free_loopback_host()
        elif self.follow_host is not None:
            self._launch("pose_follower", "shared_world", host=self.follow_host)
        try:
            for device in Device:
                if device in self.devices:
                    self._start(device)
            ready = {name: process.wait_ready() for name, process in self.processes.items()}
            if asked.video_device is not None and Device.CAMERA in self.devices:
                # Processes that are started from now on see the device.
                self.preloaded = preloaded(self.folder / VIDEO_DEVICE)
                before = {name: os.environ.get(name) for name in self.preloaded}
                self._environment = {name: value for name, value in before.items() if value}
                os.environ.update(self.preloaded)
            for fault in map(parse_fault, asked.faults):
                if fault.device in self.devices:
                    post_fault(self.folder, fault)
        except DeviceError:
            self.stop()
            raise
        logger.info("emulated devices: %s", ready)
        url = ready.get(Device.CAMERA, {}).get("url")
        self.camera_port = urlsplit(url or "").port or self.camera_port
        # The link outlives a restart of the box; the pseudo-terminal behind it does not.
        link = ready.get(Device.FORCE_SENSOR, {}).get("link")
        self.addresses = EmulatedAddresses(
            robot_host=self._robot_host or None, force_sensor_port=link, camera_url=url
        )
        return self.addresses

    def restart(self, device: Device, *, tip: Vector3 | None = None) -> None:
        """End one device and start it anew, without its faults, where it answered before.

        Args:
            tip: Where the arm is found then [m]; at home if None.
        """
        self.processes[device.value].stop()
        self._start(device, tip=tip)
        self.processes[device.value].wait_ready()

    def _start(self, device: Device, *, tip: Vector3 | None = None) -> None:
        if device is Device.FORCE_SENSOR:
            self._launch(device, "force_sensor.box")
        elif device is Device.CAMERA:
            self._launch(device, "camera.stream", host=self.camera_host, port=self.camera_port)
        else:
            self._launch(device, "arm.controller", tip=tip, host=self._robot_host)

    def _launch(
        self, name: str, module: str, *, tip: Vector3 | None = None, host: str = "", port: int = 0
    ) -> None:
        config = self.config
        if tip is not None:
            robot = config.robot.model_copy(update={"home": tip})
            config = config.model_copy(update={"robot": robot})
        settings = DeviceSettings(folder=self.folder, config=config, host=host, port=port)
        self.processes[name] = EmulatedProcess(name, module, settings)

    def gel(self) -> Plant:
        """Return a fresh gel like the one that is pressed, once a device was started.

        Raises:
            RecordError: The gel's truth cannot be read.
        """
        return plant_of(DeviceSettings(folder=self.folder, config=self.config))
