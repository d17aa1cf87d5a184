"""The ports of an emulated controller: RTDE, dashboard lines and program upload."""

import re
import socket
import struct
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import ClassVar

from drivers.arm import ur5_rtde as rtde
from drivers.emulators.arm.safety_and_registers import VERSIONS, ControllerBody
from drivers.emulators.faults import take_due
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.errors import DeviceError

_BACKLOG_LIMIT = 1 << 20
_RECEIVE_SIZE = 65536
_RESET_ON_CLOSE = struct.pack("ii", 1, 0)
_VERSION = struct.Struct(">4I")
_FREQUENCY = struct.Struct(">d")
_SCRIPT_END = re.compile(rb"^end[ \t]*\r?\n", re.MULTILINE)
_REGISTER_OFFSET = re.compile(rb"reg_offset_int\s*=\s*(\d+)")
_CONTROL_PROGRAM = re.compile(rb"^def rtde_control\(", re.MULTILINE)
_SCRIPT_LIMIT = 1 << 20


class Connection:
    """A connected client: a socket that never blocks, with an optional delay."""

    def __init__(self, link: socket.socket) -> None:
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = link
        self.alive = True  # false once the client is gone; the owner then drops it
        self.delay_s = 0.0  # added to both directions [s], to imitate a slow network
        self.partial = b""  # text that is not complete yet
        self.reader = rtde.PacketReader()  # this and the following fields belong to an RTDE client
        self.output: rtde.Recipe | None = None  # fields that the client has asked to receive
        self.inputs: list[rtde.Recipe] = []  # fields that the client has announced to send
        self.every_cycles = 1  # cycles between two states that it is sent, once ``started``
        self.started = False
        self._unsent = bytearray()
        self._late_out: deque[tuple[float, bytes]] = deque()
        self._late_in: deque[tuple[float, bytes]] = deque()

    @property
    def is_congested(self) -> bool:
        """True while earlier data wait for the client to read; newer states may be left out."""
        return bool(self._unsent)

    def receive(self, now_s: float) -> bytes:
        """Return what has arrived and is due."""
        while self.alive:
            try:
                data = self.socket.recv(_RECEIVE_SIZE)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            self.alive = bool(data)
            self._late_in.append((now_s + self.delay_s, data))
        return b"".join(take_due(self._late_in, now_s))

    def send(self, data: bytes, now_s: float) -> None:
        """Send ``data``, or keep it until it is due or the client reads."""
        self._late_out.append((now_s + self.delay_s, data))
        self.service(now_s)

    def service(self, now_s: float) -> None:
        """Send what has become due."""
        self._unsent += b"".join(take_due(self._late_out, now_s))
        if not (self.alive and self._unsent):
            return
        try:
            del self._unsent[: self.socket.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self.alive = False
        self.alive = self.alive and len(self._unsent) < _BACKLOG_LIMIT

    def close(self) -> None:
        """Close; a client that is still there sees a broken connection, no orderly end."""
        if self.alive:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET_ON_CLOSE)
        self.alive = False
        self.socket.close()


class Port(ABC):
    """A listening socket and its clients."""

    greeting: ClassVar[bytes] = b""

    def __init__(self, host: str, number: int) -> None:
        self.number = number
        self._delay_s = 0.0
        self._connections: list[Connection] = []
        self._address = (host, number)
        self._listener: socket.socket | None = None
        self.open()

    def open(self) -> None:
        """Listen."""
        if self._listener is None:
            self._listener = socket.create_server(self._address, backlog=8)
            self._listener.setblocking(False)

    def delay(self, delay_s: float) -> None:
        """Delay both directions of every connection, those to come included, by ``delay_s`` [s]."""
        self._delay_s = delay_s
        for connection in self._connections:
            connection.delay_s = delay_s

    def drop(self) -> None:
        """Break every connection and refuse new ones until ``open``."""
        for connection in self._connections:
            connection.close()
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def sockets(self) -> list[socket.socket]:
        """Return what an event loop has to watch."""
        listening = [self._listener] if self._listener is not None else []
        return listening + [c.socket for c in self._connections if c.alive]

    def service(self, now_s: float) -> None:
        """Greet new clients, take what arrived, and let go of clients that are gone."""
        while self._listener is not None:
            try:
                link, _ = self._listener.accept()
            except OSError:
                break
            connection = Connection(link)
            connection.delay_s = self._delay_s
            self._connections.append(connection)
            if self.greeting:
                connection.send(self.greeting, now_s)
        for connection in self._connections:
            data = connection.receive(now_s)
            if data:
                self._hear(connection, data, now_s)
            connection.service(now_s)
        for connection in [c for c in self._connections if not c.alive]:
            self._connections.remove(connection)
            connection.close()

    @abstractmethod
    def _hear(self, connection: Connection, data: bytes, now_s: float) -> None:
        """Take what a client sent."""


class RtdePort(Port):
    """The RTDE server: handshakes, state out, registers in."""

    def __init__(self, host: str, body: ControllerBody) -> None:
        super().__init__(host, rtde.RTDE_PORT)
        # Names of the input fields that clients wrote in the last ``service``.
        self.written: set[str] = set()
        self._body = body
        self._owners: dict[str, Connection] = {}

    def service(self, now_s: float) -> None:
        """Serve the clients; see ``Port.service``."""
        self.written.clear()
        super().service(now_s)
        self._owners = {name: owner for name, owner in self._owners.items() if owner.alive}

    def send_state(self, cycle: int, now_s: float) -> None:
        """Send the newest state to every client whose turn this cycle is."""
        for client in self._connections:
            is_due = client.started and cycle % client.every_cycles == 0
            if is_due and client.output is not None and not client.is_congested:
                data = b"\x01" + client.output.pack(self._body.outputs)
                client.send(rtde.pack_packet(rtde.PacketKind.DATA, data), now_s)

    def _hear(self, connection: Connection, data: bytes, now_s: float) -> None:
        try:
            for kind, body in connection.reader.feed(data):
                if kind == rtde.PacketKind.DATA:
                    recipe = connection.inputs[body[0] - 1]
                    self._body.inputs |= recipe.unpack(body[1:])
                    self.written.update(recipe.names)
                elif (reply := self._reply(connection, kind, body)) is not None:
                    connection.send(rtde.pack_packet(kind, reply), now_s)
        except (DeviceError, IndexError, struct.error):
            connection.alive = False

    def _reply(self, client: Connection, kind: int, body: bytes) -> bytes | None:
        if kind == rtde.PacketKind.REQUEST_PROTOCOL_VERSION:
            return bytes([int.from_bytes(body[:2], "big") == rtde.PROTOCOL_VERSION])
        if kind == rtde.PacketKind.GET_URCONTROL_VERSION:
            return _VERSION.pack(*VERSIONS[self._body.model])
        if kind == rtde.PacketKind.SETUP_OUTPUTS:
            return self._set_up_outputs(client, body)
        if kind == rtde.PacketKind.SETUP_INPUTS:
            return self._set_up_inputs(client, rtde.split_names(body))
        if kind in (rtde.PacketKind.START, rtde.PacketKind.PAUSE):
            client.started = kind == rtde.PacketKind.START and client.output is not None
            return bytes([client.started or kind == rtde.PacketKind.PAUSE])
        return None

    def _set_up_outputs(self, client: Connection, body: bytes) -> bytes:
        (frequency,) = _FREQUENCY.unpack_from(body)
        names = rtde.split_names(body[_FREQUENCY.size :])
        found = ["FOUND" if name in self._body.outputs else "NOT_FOUND" for name in names]
        if "NOT_FOUND" in found:
            return b"\x00" + ",".join(found).encode()
        rate = self._body.model.rate_hz
        client.every_cycles = max(1, round(rate / frequency)) if 0 < frequency < rate else 1
        client.output = rtde.Recipe(names, rtde.OUTPUT_TYPES)
        return b"\x01" + ",".join(client.output.types).encode()

    def _set_up_inputs(self, client: Connection, names: list[str]) -> bytes:
        types = [
            "IN_USE"
            if self._owners.get(name, client) is not client
            else rtde.INPUT_TYPES.get(name, "NOT_FOUND")
            for name in names
        ]
        if "NOT_FOUND" in types or "IN_USE" in types:
            return b"\x00" + ",".join(types).encode()
        self._owners |= dict.fromkeys(names, client)
        client.inputs.append(rtde.Recipe(names, rtde.INPUT_TYPES))
        return bytes([len(client.inputs)]) + ",".join(types).encode()


class DashboardPort(Port):
    """The dashboard server: one line in, one line out.

    Args:
        reset_safety: Called by ``unlock protective stop`` and by powering on.
    """

    greeting = b"Connected: Universal Robots Dashboard Server\n"

    def __init__(
        self,
        host: str,
        body: ControllerBody,
        *,
        stop_program: Callable[[], None],
        reset_safety: Callable[[], None],
    ) -> None:
        super().__init__(host, rtde.DASHBOARD_PORT)
        self._body = body
        self._actions = {
            "stop": (stop_program, "Stopped"),
            "unlock protective stop": (reset_safety, "Protective stop releasing"),
            "power on": (reset_safety, "Powering on"),
            "restart safety": (reset_safety, "Restarting safety"),
        }

    def _hear(self, connection: Connection, data: bytes, now_s: float) -> None:
        *lines, connection.partial = (connection.partial + data).split(b"\n")
        for line in lines:
            answer = self._answer(line.decode("latin-1").strip())
            connection.send(f"{answer}\n".encode(), now_s)

    def _answer(self, command: str) -> str:
        body = self._body
        version = ".".join(str(part) for part in VERSIONS[body.model])
        name, is_playing = body.safety.name, body.is_playing
        fixed = {
            "PolyscopeVersion": f"URSoftware {version} (Jan 01 2024)",
            "get serial number": "20195599999",
            "get robot model": "UR5",
            "robotmode": f"Robotmode: {body.safety.robot_mode.name}",
            "safetymode": f"Safetymode: {name}",
            "safetystatus": f"Safetystatus: {name}",
            "running": f"Program running: {'true' if is_playing else 'false'}",
            "programState": f"{'PLAYING' if is_playing else 'STOPPED'} rtde_control",
            "close popup": "closing popup",
            "close safety popup": "closing safety popup",
            "brake release": "Brake releasing",
        }
        if body.model is RobotModel.E_SERIES:
            fixed["is in remote control"] = "true" if body.remote_control else "false"
        if command in fixed:
            return fixed[command]
        if command in self._actions:
            action, answer = self._actions[command]
            action()
            return answer
        if command.startswith("popup "):
            return "showing popup"
        return f"could not understand: {command!r}"


class ScriptPort(Port):
    """The port that takes programs.

    Args:
        start_program: Called with the register offset when a control program is complete.
    """

    def __init__(self, host: str, *, start_program: Callable[[int], None]) -> None:
        super().__init__(host, rtde.SCRIPT_PORT)
        self._start_program = start_program

    def _hear(self, connection: Connection, data: bytes, now_s: float) -> None:  # noqa: ARG002
        text = connection.partial + data
        end = _SCRIPT_END.search(text)
        if end is None:
            connection.partial = text[-_SCRIPT_LIMIT:]
            return
        program, connection.partial = text[: end.end()], text[end.end() :]
        if _CONTROL_PROGRAM.search(program):
            offset = _REGISTER_OFFSET.search(program)
            self._start_program(int(offset.group(1)) if offset else 0)
