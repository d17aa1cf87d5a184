"""What an emulated arm noted of itself: its events, and where it truly was."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

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
