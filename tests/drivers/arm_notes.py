"""What an emulated arm noted of itself, and clients of it that are processes of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.emulators.arm.controller import EVENTS_FILE, TRACE_FILE, TRACE_ROW
from tacauchy_rig.core.run import Vector3


def read_events(folder: Path) -> list[dict[str, object]]:
    """Return the events written so far, oldest first."""
    lines = (folder / EVENTS_FILE).read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines if line.endswith("}")]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceRow:
    """True state of the tip at one cycle."""

    stamp_ns: int  # CLOCK_MONOTONIC
    position: Vector3  # x, y, z [m]
    velocity: Vector3  # vx, vy, vz [m/s]
    runtime_state: int  # state of the controller's program


def read_trace(folder: Path) -> list[TraceRow]:
    """Return the rows written so far; a row cut short by a kill is left out."""
    data = (folder / TRACE_FILE).read_bytes()
    whole = data[: len(data) - len(data) % TRACE_ROW.size]
    return [
        TraceRow(stamp_ns=s, position=(x, y, z), velocity=(u, v, w), runtime_state=state)
        for s, x, y, z, u, v, w, state in TRACE_ROW.iter_unpack(whole)
    ]


_ANSWERS = "TEST_UR5_ANSWERS"


def say(**found: object) -> None:
    """Answer from a client's process: not on stdout, where ur_rtde's words may cut a line."""
    os.write(int(os.environ[_ANSWERS]), json.dumps(found).encode() + b"\n")


def be_client(functions: dict[str, Any]) -> None:
    """Be a client's process, and leave without a farewell, as a crash would."""
    functions[sys.argv[1]](*sys.argv[2:])
    os._exit(0)


class Client:
    """A process that runs a function of a test's file, and the pipe on which it answers.

    ur_rtde holds the interpreter lock in its constructors, and what hangs there must not take the
    tests with it.
    """

    def __init__(self, file: str, scenario: str, robot: Any, *more: str) -> None:
        reading, writing = os.pipe()
        self.process = subprocess.Popen(
            [sys.executable, file, scenario, robot.host, robot.model.value, robot.folder, *more],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=[writing],
            env=os.environ | {_ANSWERS: str(writing)},
        )
        os.close(writing)
        self._answers = os.fdopen(reading)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._answers.close()
        self.process.kill()
        self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()

    def await_pressing(self) -> None:
        """Return once the arm moves down."""
        assert self.line() == {"pressing": True}

    def line(self, *, may_crash: bool = False) -> dict[str, Any]:
        """Return the next answer; nothing where the library may crash, and did.

        When a connection breaks, ur_rtde connects anew in a thread of its own, and now and then
        ends with SIGSEGV doing so.
        """
        line = self._answers.readline()
        if not line:
            self.process.wait()
            if may_crash and self.process.returncode == -signal.SIGSEGV:
                return {}
            assert self.process.stdout is not None
            said = self.process.stdout.read().decode(errors="replace")
            pytest.fail(f"the client ended with {self.process.returncode}: {said}")
        return dict(json.loads(line))
