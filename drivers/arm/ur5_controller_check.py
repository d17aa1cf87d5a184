"""Find out in plain Python, with a deadline, whether a UR controller is fit to be driven.

ur_rtde's constructors hold Python's interpreter lock and wait for ever for data that do not
come. So everything that can be wrong is looked for here first, over ordinary sockets.
"""

import re
import socket
import struct
import time
from dataclasses import dataclass
from typing import Self

from drivers.arm import ur5_rtde
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.errors import DeviceError

_OUTPUTS = ["timestamp", "robot_mode", "runtime_state", "safety_status_bits", "actual_TCP_pose"]
_OUTPUT_RATE_HZ = 125.0  # the slower of the two generations' cycles
_COMMAND_REGISTER = b"input_int_register_0"
_PACKETS_SEEN = 3
_PORT_PURPOSE = {
    ur5_rtde.RTDE_PORT: "RTDE, the controller's data exchange",
    ur5_rtde.DASHBOARD_PORT: "the dashboard server",
    ur5_rtde.SCRIPT_PORT: "the script port",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerReport:
    """What a controller says of itself."""

    host: str
    # Major, minor, bugfix and build of the controller's software.
    version: tuple[int, int, int, int]
    serial: str
    # False when the pendant is in local control; None where the software has no such mode.
    remote_control: bool | None
    in_use: bool  # true when another client owns the command registers
    robot_mode: int
    runtime_state: int
    safety_bits: int
    pose: tuple[float, ...]
    probe_s: float  # how long the probe took

    @property
    def model(self) -> RobotModel:
        """Controller generation that the version belongs to."""
        return (
            RobotModel.E_SERIES
            if self.version[0] > RobotModel.CB3.major_version
            else RobotModel.CB3
        )

    @property
    def version_text(self) -> str:
        """Version as the pendant shows it, for example ``5.11.1.108318``."""
        return ".".join(str(part) for part in self.version)


def probe_controller(host: str, *, timeout_s: float = 5.0) -> ControllerReport:
    """Ask a controller who and how it is, without moving or changing anything.

    Args:
        timeout_s: Deadline for everything together [s].

    Raises:
        DeviceError: Unreachable, silent, or not a UR controller.
    """
    start_s = time.monotonic()
    deadline_s = start_s + timeout_s
    with _Port(host, ur5_rtde.SCRIPT_PORT, deadline_s):
        pass
    with _Port(host, ur5_rtde.DASHBOARD_PORT, deadline_s) as port:
        serial, remote_control = _ask_dashboard(port)
    with _RtdePort(host, ur5_rtde.RTDE_PORT, deadline_s) as rtde:
        version = rtde.handshake()
        # Another client owns the register that takes commands.
        in_use = b"IN_USE" in rtde.ask(ur5_rtde.PacketKind.SETUP_INPUTS, _COMMAND_REGISTER)
        states = rtde.watch()
    last = states[-1]
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
        probe_s=time.monotonic() - start_s,
    )


def require_ready(report: ControllerReport, *, model: RobotModel) -> None:
    """Refuse a controller that cannot be driven now.

    Raises:
        DeviceError: Another generation than configured, local control, stopped for safety, not
            powered, or driven by another program.
    """
    where = f"robot {report.host}"
    if report.version[0] > RobotModel.E_SERIES.major_version:
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
    stopped = ur5_rtde.safety_reason(report.safety_bits)
    if stopped is not None:
        raise DeviceError(f"{where}: {stopped[0]}", remedy=stopped[1])
    if report.robot_mode != ur5_rtde.RobotMode.RUNNING:
        mode = ur5_rtde.in_words(ur5_rtde.RobotMode, report.robot_mode)
        raise DeviceError(
            f"{where}: the arm is not running ({mode})",
            remedy="power the arm on and release its brakes at the pendant",
        )
    if report.in_use:
        raise DeviceError(
            f"{where}: another program already controls it (its command registers are in use)",
            remedy="end the other client; on the pendant switch off EtherNet/IP, PROFINET and "
            "MODBUS units that write RTDE registers",
        )


class _Port:
    """A connection to one of the controller's ports, on which every wait ends at the deadline."""

    def __init__(self, host: str, port: int, deadline_s: float) -> None:
        self.place = f"robot {host}: port {port} ({_PORT_PURPOSE[port]})"
        self.host = host
        self._deadline_s = deadline_s
        try:
            self.link = socket.create_connection((host, port), timeout=self._left_s())
        except socket.gaierror as error:
            raise DeviceError(
                f"robot: the name {host!r} is unknown",
                remedy="write its address as the pendant shows it (Settings, System, Network)",
            ) from error
        except ConnectionRefusedError as error:
            raise DeviceError(
                f"{self.place} refuses connections",
                remedy="is this the robot's address, is the controller booted, is the service on?",
            ) from error
        except TimeoutError as error:
            raise self._silent() from error
        except OSError as error:
            raise DeviceError(
                f"{self.place} cannot be reached: {error.strerror or error}",
                remedy="check the cable, and that this computer is in the robot's subnet",
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def receive(self) -> bytes:
        """Return what comes next, at least one byte."""
        self.link.settimeout(self._left_s())
        try:
            data = self.link.recv(65536)
        except TimeoutError as error:
            raise self._silent() from error
        except OSError as error:
            raise self._closed(f": {error.strerror or error}") from error
        if not data:
            raise self._closed()
        return data

    def _closed(self, why: str = "") -> DeviceError:
        return DeviceError(
            f"{self.place} closed the connection{why}", remedy="look at the controller; try again"
        )

    def _left_s(self) -> float:
        left_s = self._deadline_s - time.monotonic()
        if left_s <= 0.0:
            raise self._silent()
        return left_s

    def _silent(self) -> DeviceError:
        return DeviceError(
            f"{self.place} does not answer",
            remedy="check cable, address and that the controller is on; restart it when it hangs",
        )


def _ask_dashboard(port: _Port) -> tuple[str, bool | None]:
    """Return (serial number, whether in remote control)."""
    received = b""

    def next_line() -> str:
        nonlocal received
        while b"\n" not in received:
            received += port.receive()
        line, received = received.split(b"\n", 1)
        return line.decode("latin-1").strip()

    greeting = next_line()
    if "Dashboard" not in greeting:
        raise DeviceError(
            f"robot {port.host}: port {ur5_rtde.DASHBOARD_PORT} greets with {greeting[:60]!r}",
            remedy="this is not a UR controller: correct the address",
        )
    port.link.sendall(b"get serial number\n")
    serial = re.sub(r"\D", "", next_line())
    port.link.sendall(b"is in remote control\n")
    return serial, {"true": True, "false": False}.get(next_line().lower())


class _RtdePort(_Port):
    """The handshake of an RTDE client, one reply for each request."""

    def __init__(self, host: str, port: int, deadline_s: float) -> None:
        super().__init__(host, port, deadline_s)
        self._reader = ur5_rtde.PacketReader()
        self._waiting: list[tuple[int, bytes]] = []

    def handshake(self) -> tuple[int, int, int, int]:
        """Agree on the protocol and return the controller's version."""
        request = struct.pack(">H", ur5_rtde.PROTOCOL_VERSION)
        if self.ask(ur5_rtde.PacketKind.REQUEST_PROTOCOL_VERSION, request)[:1] != b"\x01":
            raise DeviceError(
                f"{self.place} refuses protocol version {ur5_rtde.PROTOCOL_VERSION}",
                remedy="update the controller's software (3.3 or newer)",
            )
        reply = self.ask(ur5_rtde.PacketKind.GET_URCONTROL_VERSION)
        if len(reply) != struct.calcsize(">4I"):
            raise self._strange(reply)
        major, minor, bugfix, build = struct.unpack(">4I", reply)
        return major, minor, bugfix, build

    def watch(self) -> list[dict[str, tuple[float, ...]]]:
        """Return a few states, having seen the controller's clock move."""
        request = struct.pack(">d", _OUTPUT_RATE_HZ) + ",".join(_OUTPUTS).encode()
        reply = self.ask(ur5_rtde.PacketKind.SETUP_OUTPUTS, request)
        if b"NOT_FOUND" in reply or not reply:
            raise self._strange(reply)
        recipe = ur5_rtde.Recipe(_OUTPUTS, ur5_rtde.OUTPUT_TYPES)
        if self.ask(ur5_rtde.PacketKind.START)[:1] != b"\x01":
            raise DeviceError(
                f"{self.place} does not start sending data", remedy="restart the controller"
            )
        states = [
            recipe.unpack(self._next(ur5_rtde.PacketKind.DATA)[1:]) for _ in range(_PACKETS_SEEN)
        ]
        if states[-1]["timestamp"][0] <= states[0]["timestamp"][0]:
            raise DeviceError(
                f"{self.place} repeats the same time stamp", remedy="restart the controller"
            )
        return states

    def ask(self, kind: ur5_rtde.PacketKind, body: bytes = b"") -> bytes:
        """Send a request and return the body of its reply."""
        self.link.sendall(ur5_rtde.pack_packet(kind, body))
        return self._next(kind)

    def _next(self, kind: ur5_rtde.PacketKind) -> bytes:
        while True:
            while self._waiting:
                got, body = self._waiting.pop(0)
                if got == kind:
                    return body
            data = self.receive()
            try:
                self._waiting += self._reader.feed(data)
            except DeviceError as error:
                raise self._strange(data) from error

    def _strange(self, reply: bytes) -> DeviceError:
        return DeviceError(
            f"{self.place} answers {reply[:40]!r}",
            remedy="this is not a UR controller with RTDE: correct the address",
        )
