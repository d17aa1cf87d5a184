"""What an emulated arm noted of itself, and clients of it that are processes of their own."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from drivers.emulators.arm.controller import TRACE_FILE
from tacauchy_rig.core.run import Vector3
from tests.drivers.conftest import FORKED, EmulatedUr

Scenario = Callable[..., None]


def _notes(folder: Path) -> list[dict[str, Any]]:
    lines = (folder / TRACE_FILE).read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines if line.endswith("}")]


def read_events(folder: Path) -> list[dict[str, Any]]:
    """Return the events written so far, oldest first."""
    return [note for note in _notes(folder) if "name" in note]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceRow:
    """True state of the tip at one cycle."""

    stamp_ns: int  # CLOCK_MONOTONIC
    position: Vector3  # x, y, z [m]
    velocity: Vector3  # vx, vy, vz [m/s]
    runtime_state: int  # state of the controller's program


def read_trace(folder: Path) -> list[TraceRow]:
    """Return the rows written so far; a row cut short by a kill is left out."""
    rows = [note for note in _notes(folder) if "position" in note]
    vectors = ("position", "velocity")
    return [TraceRow(**row | {name: tuple(row[name]) for name in vectors}) for row in rows]


_answers: list[Connection] = []
"""Where a client's process answers."""


def say(**found: object) -> None:
    """Answer from a client's process: not on stdout, where ur_rtde's words may cut a line."""
    _answers[0].send(found)


def _be_client(answers: Connection, log: Path, scenario: Scenario, *given: str) -> None:
    """Be a client's process, and leave without a farewell, as a crash would."""
    _answers.append(answers)
    with log.open("wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    scenario(*given)
    os._exit(0)


class Client:
    """A process that runs a function, and the pipe on which it answers.

    ur_rtde holds the interpreter lock in its constructors, and what hangs there must not take the
    tests with it.
    """

    def __init__(self, scenario: Scenario, robot: EmulatedUr, *more: str) -> None:
        self._log = robot.folder / "client.log"
        self._answers, answers = FORKED.Pipe(duplex=False)
        given = (robot.host, robot.model.value, str(robot.folder), *more)
        self.process = FORKED.Process(
            target=_be_client, args=(answers, self._log, scenario, *given), daemon=True
        )
        self.process.start()
        answers.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._answers.close()
        self.process.kill()
        self.process.join()

    def await_pressing(self) -> None:
        """Return once the arm moves down."""
        assert self.line() == {"pressing": True}

    def line(self, *, may_crash: bool = False) -> dict[str, Any]:
        """Return the next answer; nothing where the library may crash, and did.

        When a connection breaks, ur_rtde connects anew in a thread of its own, and now and then
        ends with SIGSEGV doing so.
        """
        try:
            return dict(self._answers.recv())
        except EOFError:
            self.process.join()
            if may_crash and self.process.exitcode == -signal.SIGSEGV:
                return {}
            said = self._log.read_text(errors="replace")
            pytest.fail(f"the client ended with {self.process.exitcode}: {said}")
