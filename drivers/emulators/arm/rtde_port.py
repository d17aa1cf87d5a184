"""Port 30004 of an emulated controller: RTDE handshakes, state out, registers in."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from drivers.arm.ur5_wire import (
    INPUT_TYPES,
    PROTOCOL_VERSION,
    RTDE_PORT,
    InputRecipe,
    OutputRecipe,
    PacketKind,
    PacketReader,
    pack_packet,
    split_names,
)
from drivers.emulators.arm.body import VERSIONS, ControllerBody
from drivers.emulators.arm.connection import Connection, Port
from tacauchy_rig.core.errors import DeviceError

_VERSION = struct.Struct(">4I")
_FREQUENCY = struct.Struct(">d")


@dataclass(slots=True)
class _Client:
    """What the controller remembers of one connection."""

    connection: Connection
    reader: PacketReader = field(default_factory=PacketReader)
    output: OutputRecipe | None = None
    inputs: list[InputRecipe] = field(default_factory=list)
    every_cycles: int = 1
    started: bool = False


class RtdePort:
    """The RTDE server."""

    def __init__(self, host: str, body: ControllerBody) -> None:
        self.port = Port(host, RTDE_PORT)
        self._body = body
        self._clients: dict[Connection, _Client] = {}
        self._owners: dict[str, Connection] = {}

    def service(self, now_s: float) -> set[str]:
        """Read what clients sent; return the names of the input fields they wrote."""
        for connection in self.port.accept():
            self._clients[connection] = _Client(connection=connection)
        written: set[str] = set()
        for connection, client in self._clients.items():
            data = connection.receive(now_s)
            if data:
                self._take(client, data, written, now_s)
            connection.service(now_s)
        for connection in self.port.reap():
            self._clients.pop(connection, None)
            self._owners = {n: owner for n, owner in self._owners.items() if owner != connection}
        return written

    def send_state(self, cycle: int, now_s: float) -> None:
        """Send the newest state to every client whose turn this cycle is."""
        outputs = self._body.outputs
        for client in self._clients.values():
            if client.started and client.output is not None and cycle % client.every_cycles == 0:
                packet = client.output.pack(outputs)
                if not client.connection.is_congested:
                    client.connection.send(packet, now_s)

    def _take(self, client: _Client, data: bytes, written: set[str], now_s: float) -> None:
        try:
            for kind, body in client.reader.feed(data):
                if kind == PacketKind.DATA:
                    self._write_inputs(client, body, written)
                else:
                    reply = self._reply(client, kind, body)
                    if reply is not None:
                        client.connection.send(pack_packet(kind, reply), now_s)
        except (DeviceError, IndexError, struct.error):
            client.connection.alive = False

    def _write_inputs(self, client: _Client, body: bytes, written: set[str]) -> None:
        recipe = client.inputs[body[0] - 1]
        recipe.unpack_into(body[1:], self._body.inputs)
        written.update(recipe.names)

    def _reply(self, client: _Client, kind: int, body: bytes) -> bytes | None:
        if kind == PacketKind.REQUEST_PROTOCOL_VERSION:
            return bytes([int.from_bytes(body[:2], "big") == PROTOCOL_VERSION])
        if kind == PacketKind.GET_URCONTROL_VERSION:
            return _VERSION.pack(*VERSIONS[self._body.model])
        if kind == PacketKind.SETUP_OUTPUTS:
            return self._set_up_outputs(client, body)
        if kind == PacketKind.SETUP_INPUTS:
            return self._set_up_inputs(client, split_names(body))
        if kind in (PacketKind.START, PacketKind.PAUSE):
            client.started = kind == PacketKind.START and client.output is not None
            return bytes([client.started or kind == PacketKind.PAUSE])
        return None

    def _set_up_outputs(self, client: _Client, body: bytes) -> bytes:
        (frequency,) = _FREQUENCY.unpack_from(body)
        names = split_names(body[_FREQUENCY.size :])
        known = [name for name in names if name in self._body.outputs]
        if known != names:
            return b"\x00" + b",".join(
                b"FOUND" if name in self._body.outputs else b"NOT_FOUND" for name in names
            )
        rate = self._body.model.rate_hz
        client.every_cycles = max(1, round(rate / frequency)) if 0 < frequency < rate else 1
        client.output = OutputRecipe(1, names)
        return b"\x01" + ",".join(client.output.types).encode()

    def _set_up_inputs(self, client: _Client, names: list[str]) -> bytes:
        types = []
        for name in names:
            if name not in INPUT_TYPES:
                types.append("NOT_FOUND")
            elif self._owners.get(name, client.connection) is not client.connection:
                types.append("IN_USE")
            else:
                types.append(INPUT_TYPES[name])
        if "NOT_FOUND" in types or "IN_USE" in types:
            return b"\x00" + ",".join(types).encode()
        self._owners |= dict.fromkeys(names, client.connection)
        client.inputs.append(InputRecipe(names))
        return bytes([len(client.inputs)]) + ",".join(types).encode()
