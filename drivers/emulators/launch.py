"""Start emulated devices as processes of their own and say where they answer."""

import logging
import os
import random
import socket
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from drivers.emulators.camera.frames_and_noise import VIDEO_DEVICE, preloaded
from drivers.emulators.faults import Device, parse_fault
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import EmulatedUnit, draw_truth, write_truth
from drivers.emulators.process import DeviceSettings, EmulatedProcess, post_fault
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError

logger = logging.getLogger(__name__)

UR_PORTS = (30004, 29999, 30003)


def emulated_devices(config: RigConfig) -> frozenset[Device]:
    """Return the devices whose driver is ``emulated``."""
    return frozenset(each for each in Device if getattr(config, each.value).is_emulated)


def free_loopback_host() -> str:
    """Return a loopback address whose three controller ports are free.

    ur_rtde fixes the ports, so each emulated controller needs an address of its own.
    """
    source = random.Random()  # noqa: S311 - an address, not a secret
    for _ in range(200):
        host = f"127.{source.randint(1, 250)}.{source.randint(1, 250)}.{source.randint(2, 250)}"
        with suppress(OSError), ExitStack() as held:
            for port in UR_PORTS:
                held.enter_context(socket.create_server((host, port)))
            return host
    raise DeviceError(
        "emulated robot: no loopback address has ports 30004, 29999 and 30003 free",
        remedy="end other emulators, or set emulation.robot_host",
    )


@dataclass(eq=False)
class Emulation:
    """The emulated part of a rig, running."""

    config: RigConfig
    folder: Path
    devices: frozenset[Device]
    camera_host: str = "127.0.0.1"
    camera_port: int = 0
    # A robot that is not emulated here, whose reported pose moves the indenter of the emulated
    # world; needed when a sensor or camera is emulated and the robot is not.
    follow_host: str | None = None
    unit: EmulatedUnit | None = None  # make of sensor that is emulated; a GelSight Mini if None
    processes: dict[str, EmulatedProcess] = field(default_factory=dict, init=False)
    # ``config`` with the addresses at which the started devices answer; that of a camera which is
    # played through V4L2 is the path of its device.
    running: RigConfig = field(init=False)
    # Environment by which other programs see such a camera.
    preloaded: dict[str, str] = field(default_factory=dict, init=False)
    _environment: dict[str, str] = field(default_factory=dict, init=False)
    _robot_host: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self.folder, self.running = self.folder.resolve(), self.config

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End every emulator."""
        for process in self.processes.values():
            process.stop()
        for name in self.preloaded:
            os.environ.pop(name, None)
        os.environ.update(self._environment)
        self.preloaded, self._environment = {}, {}

    def start(self) -> RigConfig:
        """Start every emulator and return the configuration with their addresses.

        Raises:
            DeviceError: One of them did not come up; the others are ended again.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        asked = self.config.emulation
        truth = draw_truth(
            asked.seed,
            unit=self.unit or EmulatedUnit(),
            friction=asked.friction,
            tilt_rad=asked.tilt,
        )
        write_truth(self.folder, truth)
        self.gel()  # its table is made here once: that may take longer than a device's coming up
        SharedWorld.create(self.folder / WORLD_FILE).close()
        try:
            if Device.ROBOT in self.devices:
                is_free = asked.robot_host == "auto"
                self._robot_host = free_loopback_host() if is_free else asked.robot_host
            elif self.follow_host is not None:
                self._launch("pose_follower", "shared_world", host=self.follow_host)
            for device in Device:
                if device in self.devices:
                    self.start_device(device)
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
        except BaseException:  # an operator's Ctrl-C too
            self.stop()
            raise
        logger.info("emulated devices: %s", ready)
        url = ready.get(Device.CAMERA, {}).get("url")
        self.camera_port = urlsplit(url or "").port or self.camera_port
        places = {
            Device.ROBOT: {"host": self._robot_host},
            # The link outlives a restart of the box; the pseudo-terminal behind it does not.
            Device.FORCE_SENSOR: {"port": ready.get(Device.FORCE_SENSOR, {}).get("link")},
            Device.CAMERA: {"device": url},
        }
        changes = {
            each.value: getattr(self.config, each).model_copy(update=places[each])
            for each in self.devices
        }
        self.running = self.config.model_copy(update=changes)
        return self.running

    def start_device(self, device: Device) -> None:
        """Start one device as ``config`` says, where it answered before if it did."""
        module, host, port = {
            Device.ROBOT: ("arm.controller", self._robot_host, 0),
            Device.FORCE_SENSOR: ("force_sensor.m8128_box_and_noise", "", 0),
            Device.CAMERA: ("camera.frames_and_noise", self.camera_host, self.camera_port),
        }[device]
        self._launch(device, module, host=host, port=port)

    def _launch(self, name: str, module: str, *, host: str, port: int = 0) -> None:
        settings = DeviceSettings(folder=self.folder, config=self.config, host=host, port=port)
        self.processes[name] = EmulatedProcess(name, module, settings)

    def gel(self) -> Plant:
        """Return a fresh gel like the one that is pressed, once a device was started.

        Raises:
            RecordError: The gel's truth cannot be read.
        """
        return plant_of(DeviceSettings(folder=self.folder, config=self.config))
