"""The rig of a fault case: emulated devices that outlive the run, and its ``rig.toml``."""

from __future__ import annotations

import re
import socket
import sys
from importlib import resources
from pathlib import Path

from jinja2 import Template

from drivers.arm.ur5_rtde import DASHBOARD_PORT
from drivers.emulators.faults import Device, Fault, FaultKind
from drivers.emulators.force_sensor.m8128_box_and_noise import LINK_NAME
from drivers.emulators.launch import Emulation, free_loopback_host
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tests.drivers.arm_notes import TraceRow, read_trace
from tests.studies.fault_table.cases import DWELL_S, TARGET_N

EMULATION_NAME = "emulation"
_DASHBOARD_TIMEOUT_S = 5.0
_PERSON_AT_THE_PENDANT = {
    FaultKind.PROTECTIVE_STOP: "unlock protective stop",
    FaultKind.EMERGENCY_STOP: "power on",
}


def write_case_config(
    folder: Path,
    *,
    host: str = "127.0.0.5",
    camera_port: int = 8080,
    target_n: float = TARGET_N,
    dwell_s: float = DWELL_S,
) -> Path:
    """Write the ``rig.toml`` of a fault case, whose devices count as real ones."""
    path = folder / "rig.toml"
    port = folder / EMULATION_NAME / LINK_NAME
    template = resources.files("tests.studies.fault_table").joinpath("rig.toml.jinja").read_text()
    text = Template(template).render(
        folder=folder,
        host=host,
        port=port,
        camera_port=camera_port,
        target_n=target_n,
        dwell_s=dwell_s,
    )
    path.write_text(text, encoding="utf-8")
    return path


class EmulatedRig:
    """Emulated robot, force sensor and camera at addresses that a restart keeps."""

    def __init__(
        self, folder: Path, *, target_n: float = TARGET_N, dwell_s: float = DWELL_S
    ) -> None:
        self.folder = folder.resolve()
        self.folder.mkdir(parents=True, exist_ok=True)
        host = free_loopback_host()
        camera_port = _free_port(host)
        # Configuration that takes them for real devices.
        self.rig_toml = write_case_config(
            self.folder, host=host, camera_port=camera_port, target_n=target_n, dwell_s=dwell_s
        )
        self.config: RigConfig = load_config(self.rig_toml).config
        # To be started and stopped by whoever uses them.
        self.devices = Emulation(
            self.config,
            folder=self.folder / EMULATION_NAME,
            devices=frozenset(Device),
            camera_host=host,
            camera_port=camera_port,
        )

    def mend(self, cause: Fault | None) -> None:
        """Do what a person does after the fault: unlock, power on, or exchange the device.

        The arm stays where the fault has left it.
        """
        if cause is not None and cause.device is not Device.ROBOT:
            self._exchange(cause.device)
        elif cause is not None and cause.kind not in _PERSON_AT_THE_PENDANT:
            robot = self.config.robot.model_copy(update={"home": self.arm_trace()[-1].position})
            self.devices.config = self.config.model_copy(update={"robot": robot})
            self._exchange(Device.ROBOT)
        for command in _PERSON_AT_THE_PENDANT.values():
            self._tell_dashboard(command)

    def _exchange(self, device: Device) -> None:
        """End a device and start it anew, without its faults."""
        self.devices.processes[device.value].stop()
        self.devices.start_device(device)
        self.devices.processes[device.value].wait_ready()

    def arm_trace(self) -> list[TraceRow]:
        """Return what the emulated arm truly did so far."""
        return read_trace(self.devices.folder)

    def without_places(self, text: str) -> str:
        """Return a message without addresses and paths of this case or this computer."""
        run = re.compile(re.escape(f"{self.folder}/runs/") + r"[^\s/`]+")
        text = run.sub("RUN", text).replace(str(self.folder), "WORK")
        text = text.replace(sys.executable, Path(sys.executable).name)
        text = text.replace(f"robot {self.config.robot.host}", "robot")
        return text.replace(self.config.camera.device, "URL")

    def _tell_dashboard(self, command: str) -> None:
        address = (self.config.robot.host, DASHBOARD_PORT)
        with socket.create_connection(address, timeout=_DASHBOARD_TIMEOUT_S) as connection:
            lines = connection.makefile("rw", encoding="utf-8", newline="\n")
            lines.readline()
            lines.write(f"{command}\n")
            lines.flush()
            lines.readline()


def _free_port(host: str) -> int:
    with socket.socket() as probe:
        probe.bind((host, 0))
        port: int = probe.getsockname()[1]
        return port
