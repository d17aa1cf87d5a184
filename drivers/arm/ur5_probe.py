"""Find out in plain Python, with a deadline, whether a UR controller is fit to be driven.

ur_rtde's constructors hold Python's interpreter lock and wait for ever for data that do not
come. So everything that can be wrong is looked for here first, over ordinary sockets.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

from drivers.arm.ur5_dialogue import DashboardDialogue, RtdeDialogue, connect_port
from drivers.arm.ur5_model import UrModel
from drivers.arm.ur5_safety import RobotMode, robot_mode_name, safety_reason
from drivers.arm.ur5_wire import DASHBOARD_PORT, RTDE_PORT, SCRIPT_PORT
from tacauchy_rig.errors import DeviceError


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerReport:
    """What a controller says of itself.

    Attributes:
        version: Major, minor, bugfix and build of the controller's software.
        remote_control: False when the pendant is in local control; None where the software has
            no such mode.
        in_use: True when another client owns the command registers.
        data_period_s: Time between the data packets that were seen, by the controller's clock.
        probe_s: How long the probe took.
    """

    host: str
    version: tuple[int, int, int, int]
    serial: str
    remote_control: bool | None
    in_use: bool
    robot_mode: int
    runtime_state: int
    safety_bits: int
    pose: tuple[float, ...]
    data_period_s: float
    probe_s: float

    @property
    def model(self) -> UrModel:
        """Controller generation that the version belongs to."""
        return UrModel.E_SERIES if self.version[0] > UrModel.CB3.major_version else UrModel.CB3

    @property
    def version_text(self) -> str:
        """Version as the pendant shows it, for example ``5.11.1.108318``."""
        return ".".join(str(part) for part in self.version)


def probe_controller(host: str, *, timeout_s: float = 5.0) -> ControllerReport:
    """Ask a controller who and how it is, without moving or changing anything.

    Args:
        host: Name or address.
        timeout_s: Deadline for everything together [s].

    Raises:
        DeviceError: Unreachable, silent, or not a UR controller.
    """
    start_s = time.monotonic()
    deadline_s = start_s + timeout_s
    with connect_port(host, SCRIPT_PORT, deadline_s):
        pass
    serial, remote_control = _ask_dashboard(host, deadline_s)
    with connect_port(host, RTDE_PORT, deadline_s) as link:
        rtde = RtdeDialogue(host, link, deadline_s)
        version = rtde.handshake()
        in_use = rtde.command_register_in_use()
        states = rtde.watch()
    first, last = states[0], states[-1]
    return ControllerReport(
        host=host,
        version=version,
        serial=serial,
        remote_control=remote_control,
        in_use=in_use,
        robot_mode=int(last["robot_mode"][0]),
        runtime_state=int(last["runtime_state"][0]),
        safety_bits=int(last["safety_status_bits"][0]),
        pose=last["actual_TCP_pose"],
        data_period_s=(last["timestamp"][0] - first["timestamp"][0]) / (len(states) - 1),
        probe_s=time.monotonic() - start_s,
    )


def require_ready(report: ControllerReport, *, model: UrModel) -> None:
    """Refuse a controller that cannot be driven now.

    Raises:
        DeviceError: Another generation than configured, local control, stopped for safety, not
            powered, or driven by another program.
    """
    where = f"robot {report.host}"
    if report.version[0] > UrModel.E_SERIES.major_version:
        raise DeviceError(
            f"{where}: controller software {report.version_text} is not supported",
            remedy="a CB3 with 3.x or an e-Series with 5.x is needed",
        )
    if report.model is not model:
        raise DeviceError(
            f"{where}: its software {report.version_text} is that of a {report.model.value}, "
            f"configured is {model.value}",
            remedy=f'set model = "{report.model.value}" or correct the address',
        )
    if report.remote_control is False:
        raise DeviceError(
            f"{where}: is in local control",
            remedy="switch it to remote control at the pendant (top right)",
        )
    stopped = safety_reason(report.safety_bits)
    if stopped is not None:
        raise DeviceError(f"{where}: {stopped[0]}", remedy=stopped[1])
    if report.robot_mode != RobotMode.RUNNING:
        raise DeviceError(
            f"{where}: the arm is not running ({robot_mode_name(report.robot_mode)})",
            remedy="power the arm on and release its brakes at the pendant",
        )
    if report.in_use:
        raise DeviceError(
            f"{where}: another program already controls it (its command registers are in use)",
            remedy="end the other client; on the pendant switch off EtherNet/IP, PROFINET and "
            "MODBUS units that write RTDE registers",
        )


def _ask_dashboard(host: str, deadline_s: float) -> tuple[str, bool | None]:
    """Return (serial number, whether in remote control)."""
    with connect_port(host, DASHBOARD_PORT, deadline_s) as link:
        dashboard = DashboardDialogue(host, link, deadline_s)
        greeting = dashboard.read_line()
        if "Dashboard" not in greeting:
            raise DeviceError(
                f"robot {host}: port {DASHBOARD_PORT} greets with {greeting[:60]!r}",
                remedy="this is not a UR controller: correct the address",
            )
        serial = re.sub(r"\D", "", dashboard.ask("get serial number"))
        answer = dashboard.ask("is in remote control").lower()
    known = {"true": True, "false": False}
    return serial, known.get(answer.strip())
