"""Ports 29999 and 30003 of an emulated controller: dashboard lines and program upload."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from drivers.arm.ur5_safety import RobotMode, RuntimeState
from drivers.arm.ur5_wire import DASHBOARD_PORT, SCRIPT_PORT
from drivers.emulators.arm.body import VERSIONS, ControllerBody
from drivers.emulators.arm.connection import Connection, Port
from tacauchy_rig.core.config.model import RobotModel

_SCRIPT_END = re.compile(rb"^end[ \t]*\r?\n", re.MULTILINE)
_REGISTER_OFFSET = re.compile(rb"reg_offset_int\s*=\s*(\d+)")
_CONTROL_PROGRAM = re.compile(rb"^def rtde_control\(", re.MULTILINE)
_SCRIPT_LIMIT = 1 << 20


class _TextPort(ABC):
    """A port that keeps each client's text until there is something to do with it."""

    greeting: ClassVar[bytes] = b""

    def __init__(self, host: str, number: int) -> None:
        self.port = Port(host, number)
        self._partial: dict[Connection, bytes] = {}

    def service(self, now_s: float) -> None:
        """Greet new clients and take what arrived."""
        for connection in self.port.accept():
            self._partial[connection] = b""
            if self.greeting:
                connection.send(self.greeting, now_s)
        for connection in self.port.connections:
            text = self._partial[connection] + connection.receive(now_s)
            replies, self._partial[connection] = self._take(text)
            for reply in replies:
                connection.send(reply, now_s)
            connection.service(now_s)
        for connection in self.port.reap():
            self._partial.pop(connection, None)

    @abstractmethod
    def _take(self, text: bytes) -> tuple[list[bytes], bytes]:
        """Do what a client's text asks for; return the replies and what is not complete yet."""


class DashboardPort(_TextPort):
    """The dashboard server: one line in, one line out.

    Args:
        stop_program: Called by ``stop``.
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
        super().__init__(host, DASHBOARD_PORT)
        self._body = body
        self._stop_program = stop_program
        self._reset_safety = reset_safety

    def _take(self, text: bytes) -> tuple[list[bytes], bytes]:
        *lines, rest = text.split(b"\n")
        answers = [self._answer(line.decode("latin-1").strip()) for line in lines]
        return [f"{answer}\n".encode() for answer in answers], rest

    def _answer(self, command: str) -> str:
        body = self._body
        model, safety = body.model, body.safety
        playing = body.runtime_state == RuntimeState.PLAYING
        version = ".".join(str(part) for part in VERSIONS[model])
        fixed = {
            "PolyscopeVersion": f"URSoftware {version} (Jan 01 2024)",
            "get serial number": "20195599999",
            "get robot model": "UR5",
            "robotmode": f"Robotmode: {RobotMode(safety.robot_mode).name}",
            "safetymode": f"Safetymode: {safety.name}",
            "safetystatus": f"Safetystatus: {safety.name}",
            "running": f"Program running: {'true' if playing else 'false'}",
            "programState": f"{'PLAYING' if playing else 'STOPPED'} rtde_control",
            "close popup": "closing popup",
            "close safety popup": "closing safety popup",
            "brake release": "Brake releasing",
        }
        if model is RobotModel.E_SERIES:
            fixed["is in remote control"] = "true" if body.remote_control else "false"
        if command in fixed:
            return fixed[command]
        if command == "stop":
            self._stop_program()
            return "Stopped"
        if command in ("unlock protective stop", "power on", "restart safety"):
            self._reset_safety()
            return {
                "unlock protective stop": "Protective stop releasing",
                "power on": "Powering on",
                "restart safety": "Restarting safety",
            }[command]
        if command.startswith("popup "):
            return "showing popup"
        return f"could not understand: {command!r}"


class ScriptPort(_TextPort):
    """The port that takes programs.

    Args:
        start_program: Called with the register offset when a control program is complete.
    """

    def __init__(self, host: str, *, start_program: Callable[[int], None]) -> None:
        super().__init__(host, SCRIPT_PORT)
        self._start_program = start_program

    def _take(self, text: bytes) -> tuple[list[bytes], bytes]:
        end = _SCRIPT_END.search(text)
        if end is None:
            return [], text[-_SCRIPT_LIMIT:]
        program = text[: end.end()]
        if _CONTROL_PROGRAM.search(program):
            offset = _REGISTER_OFFSET.search(program)
            self._start_program(int(offset.group(1)) if offset else 0)
        return [], text[end.end() :]
