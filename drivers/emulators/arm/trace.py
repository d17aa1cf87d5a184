"""What the emulated arm truly did, kept beside it, so that anyone can say how a fault ended.

``arm_trace.bin`` holds one row for each controller cycle in which the arm moved (and one a
second while it rests); ``arm_events.jsonl`` one line for each thing that happened to it.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.core.run import Vector3, Vector6

TRACE_FILE = "arm_trace.bin"
EVENTS_FILE = "arm_events.jsonl"

_ROW = struct.Struct("<q6dB7x")  # stamp, position, velocity, program state, padding
_REST_PERIOD_NS = 1_000_000_000
_FLUSH_PERIOD_NS = 100_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceRow:
    """True state of the tip at one cycle.

    Attributes:
        stamp_ns: CLOCK_MONOTONIC.
        position: x, y, z [m].
        velocity: vx, vy, vz [m/s].
        runtime_state: State of the controller's program.
    """

    stamp_ns: int
    position: Vector3
    velocity: Vector3
    runtime_state: int


class ArmTrace:
    """Writes both files, buffered for at most 0.1 s."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._rows = (folder / TRACE_FILE).open("ab")
        self._events = (folder / EVENTS_FILE).open("a", encoding="utf-8")
        self._last_row_ns = 0
        self._last_flush_ns = 0
        self._was_moving = True

    def add(self, stamp_ns: int, position: Vector3, velocity: Vector6, runtime_state: int) -> None:
        """Note one cycle."""
        moving = velocity[0] != 0.0 or velocity[1] != 0.0 or velocity[2] != 0.0
        if moving or self._was_moving or stamp_ns - self._last_row_ns >= _REST_PERIOD_NS:
            self._rows.write(_ROW.pack(stamp_ns, *position, *velocity[:3], runtime_state))
            self._last_row_ns = stamp_ns
        self._was_moving = moving
        if stamp_ns - self._last_flush_ns >= _FLUSH_PERIOD_NS:
            self._rows.flush()
            self._last_flush_ns = stamp_ns

    def note(self, stamp_ns: int, name: str, pose: Vector6, **detail: object) -> None:
        """Note that something happened."""
        line = {"stamp_ns": stamp_ns, "name": name, "z_m": pose[2], **detail}
        self._events.write(json.dumps(line) + "\n")
        self._events.flush()

    def close(self) -> None:
        """Write what is buffered."""
        self._rows.close()
        self._events.close()


def read_trace(folder: Path) -> list[TraceRow]:
    """Return the rows written so far; a row cut short by a kill is left out."""
    data = (folder / TRACE_FILE).read_bytes()
    whole = data[: len(data) - len(data) % _ROW.size]
    return [
        TraceRow(stamp_ns=s, position=(x, y, z), velocity=(u, v, w), runtime_state=state)
        for s, x, y, z, u, v, w, state in _ROW.iter_unpack(whole)
    ]
