"""Talk to a UR controller's ports in plain Python, every wait ending at a deadline."""

from __future__ import annotations

import socket
import struct
import time

from drivers.arm.ur5_wire import (
    DASHBOARD_PORT,
    PROTOCOL_VERSION,
    RTDE_PORT,
    SCRIPT_PORT,
    OutputRecipe,
    PacketKind,
    PacketReader,
    pack_packet,
)
from tacauchy_rig.errors import DeviceError

_OUTPUTS = ["timestamp", "robot_mode", "runtime_state", "safety_status_bits", "actual_TCP_pose"]
_COMMAND_REGISTER = b"input_int_register_0,"
_PACKETS_SEEN = 3
_PORT_PURPOSE = {
    RTDE_PORT: "RTDE, the controller's data exchange",
    DASHBOARD_PORT: "the dashboard server",
    SCRIPT_PORT: "the script port",
}


def connect_port(host: str, port: int, deadline_s: float) -> socket.socket:
    """Return a connection to one of the controller's ports.

    Raises:
        DeviceError: Unknown name, refused, unreachable or silent.
    """
    place = f"robot {host}: port {port} ({_PORT_PURPOSE[port]})"
    try:
        return socket.create_connection((host, port), timeout=_left(place, deadline_s))
    except socket.gaierror as error:
        raise DeviceError(
            f"robot: the name {host!r} is unknown",
            remedy="write its address as the pendant shows it (Settings, System, Network)",
        ) from error
    except ConnectionRefusedError as error:
        raise DeviceError(
            f"{place} refuses connections",
            remedy="is this the robot's address, is the controller booted, is the service on?",
        ) from error
    except TimeoutError as error:
        raise _silent(place) from error
    except OSError as error:
        raise DeviceError(
            f"{place} cannot be reached: {error.strerror or error}",
            remedy="check the cable, and that this computer is in the robot's subnet",
        ) from error


def _left(place: str, deadline_s: float) -> float:
    left_s = deadline_s - time.monotonic()
    if left_s <= 0.0:
        raise _silent(place)
    return left_s


def _silent(place: str) -> DeviceError:
    return DeviceError(
        f"{place} does not answer",
        remedy="check cable, address and that the controller is on; restart it when it hangs",
    )


class DashboardDialogue:
    """A dialogue of lines with the dashboard server."""

    def __init__(self, host: str, link: socket.socket, deadline_s: float) -> None:
        self._place = f"robot {host}: port {DASHBOARD_PORT} ({_PORT_PURPOSE[DASHBOARD_PORT]})"
        self._link = link
        self._deadline_s = deadline_s
        self._buffer = b""

    def ask(self, command: str) -> str:
        """Send a command and return the line it answers."""
        self._link.sendall(command.encode() + b"\n")
        return self.read_line()

    def read_line(self) -> str:
        """Return the next line."""
        while b"\n" not in self._buffer:
            self._buffer += _receive(self._place, self._link, self._deadline_s)
        line, self._buffer = self._buffer.split(b"\n", 1)
        return line.decode("latin-1").strip()


class RtdeDialogue:
    """The handshake of an RTDE client, one reply for each request."""

    def __init__(self, host: str, link: socket.socket, deadline_s: float) -> None:
        self._place = f"robot {host}: port {RTDE_PORT} ({_PORT_PURPOSE[RTDE_PORT]})"
        self._link = link
        self._deadline_s = deadline_s
        self._reader = PacketReader()
        self._waiting: list[tuple[int, bytes]] = []

    def handshake(self) -> tuple[int, int, int, int]:
        """Agree on the protocol and return the controller's version."""
        request = struct.pack(">H", PROTOCOL_VERSION)
        if self._ask(PacketKind.REQUEST_PROTOCOL_VERSION, request)[:1] != b"\x01":
            raise DeviceError(
                f"{self._place} refuses protocol version {PROTOCOL_VERSION}",
                remedy="update the controller's software (3.3 or newer)",
            )
        reply = self._ask(PacketKind.GET_URCONTROL_VERSION)
        if len(reply) != struct.calcsize(">4I"):
            raise self._strange(reply)
        major, minor, bugfix, build = struct.unpack(">4I", reply)
        return major, minor, bugfix, build

    def command_register_in_use(self) -> bool:
        """Return whether another client owns the register that takes commands."""
        return b"IN_USE" in self._ask(PacketKind.SETUP_INPUTS, _COMMAND_REGISTER)

    def watch(self) -> list[dict[str, tuple[float, ...]]]:
        """Return a few states, having seen the controller's clock move."""
        names = ",".join(_OUTPUTS) + ","
        reply = self._ask(PacketKind.SETUP_OUTPUTS, struct.pack(">d", 125.0) + names.encode())
        if b"NOT_FOUND" in reply or not reply:
            raise self._strange(reply)
        recipe = OutputRecipe(reply[0], _OUTPUTS)
        if self._ask(PacketKind.START)[:1] != b"\x01":
            raise DeviceError(
                f"{self._place} does not start sending data", remedy="restart the controller"
            )
        states = [recipe.unpack(self._next(PacketKind.DATA)) for _ in range(_PACKETS_SEEN)]
        if states[-1]["timestamp"][0] <= states[0]["timestamp"][0]:
            raise DeviceError(
                f"{self._place} repeats the same time stamp", remedy="restart the controller"
            )
        return states

    def _ask(self, kind: PacketKind, body: bytes = b"") -> bytes:
        self._link.sendall(pack_packet(kind, body))
        return self._next(kind)

    def _next(self, kind: PacketKind) -> bytes:
        while True:
            while self._waiting:
                got, body = self._waiting.pop(0)
                if got == kind:
                    return body
            data = _receive(self._place, self._link, self._deadline_s)
            try:
                self._waiting += self._reader.feed(data)
            except DeviceError as error:
                raise self._strange(data) from error

    def _strange(self, reply: bytes) -> DeviceError:
        return DeviceError(
            f"{self._place} answers {reply[:40]!r}",
            remedy="this is not a UR controller with RTDE: correct the address",
        )


def _receive(place: str, link: socket.socket, deadline_s: float) -> bytes:
    link.settimeout(_left(place, deadline_s))
    try:
        data = link.recv(65536)
    except TimeoutError as error:
        raise _silent(place) from error
    except OSError as error:
        raise DeviceError(
            f"{place} broke the connection: {error.strerror or error}",
            remedy="look at the controller; try again",
        ) from error
    if not data:
        raise DeviceError(
            f"{place} closed the connection", remedy="look at the controller; try again"
        )
    return data
