"""Where the emulated force sensor's values come from, and their truth on disk."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.core.force_check import GRAVITY_M_S2
from tacauchy_rig.core.rotations import rotated
from tacauchy_rig.core.run import Vector3, Vector6


class ForceChannel:
    """Offset, drift, cross talk and noise of one sensor, in its own frame.

    Its frame is the tool's, turned by half a turn about x where its Fz is positive while the
    indenter is pressed.

    Args:
        compression_sign: 1 where it is mounted like that, -1 where it is mounted as the tool is.
    """

    def __init__(self, truth: PlantTruth, *, start_ns: int, compression_sign: int = 1) -> None:
        self._truth = truth
        self._sign = -compression_sign
        self._start_ns = start_ns
        self._noise = np.random.default_rng([truth.seed, 1])

    def reading(
        self, force: Vector3, torque: Vector3, rotation_vector: Vector3, stamp_ns: int
    ) -> Vector6:
        """Return Fx, Fy, Fz [N], Mx, My, Mz [N m] as the sensor reports them.

        Args:
            force: On the indenter, in the base frame [N].
            torque: On the indenter about the tip, in the base frame [N m].
            rotation_vector: Orientation of the tool in the base frame [rad].
            stamp_ns: When; drift counts from the channel's start.
        """
        truth = self._truth
        x, y, z = rotation_vector
        back = (-x, -y, -z)
        (fx, fy, fz), (mx, my, mz) = rotated(force, back), rotated(torque, back)
        fy, fz, my, mz = (self._sign * value for value in (fy, fz, my, mz))
        drift = truth.force_drift_n_s * (stamp_ns - self._start_ns) * 1e-9
        f_noise = (truth.force_noise_n * self._noise.standard_normal(3)).tolist()
        m_noise = (truth.torque_noise_nm * self._noise.standard_normal(3)).tolist()
        offset, talk = truth.force_offset_n, truth.cross_talk
        return (
            fx + talk[0] * fz + offset[0] + f_noise[0],
            fy + talk[1] * fz + offset[1] + f_noise[1],
            fz + offset[2] + drift + f_noise[2],
            mx + m_noise[0],
            my + m_noise[1],
            mz + m_noise[2],
        )


_DOWN: Vector3 = (0.0, math.pi, 0.0)  # how a tool hangs
TRACE_FILE = "force_trace.jsonl"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def open_trace(path: Path, *, boot_id: str | None = None) -> TextIO:
    """Open the trace for more lines; the first line names the boot that its stamps belong to."""
    first = json.dumps({"boot_id": boot_id or BOOT_ID.read_text("ascii").strip()}) + "\n"
    before = path.read_text("utf-8") if path.is_file() else ""
    if not before.startswith(first):
        path.write_text(first, encoding="utf-8")
        before = first
    trace = path.open("a", encoding="utf-8")
    if not before.endswith("\n"):
        trace.write("\n")  # a kill has torn the last line
    return trace


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedForce:
    """What the emulated sensor reads and what is true at that moment."""

    reading: Vector6  # Fx, Fy, Fz [N], Mx, My, Mz [N m] with noise, drift and cross-talk
    force_true_n: float  # pressing force without any of these [N]
    # Depth of the tip below the unloaded surface [m], negative above it; None where that means
    # nothing: no gel, or the tip is beside it.
    depth_true_m: float | None


class WrenchSource:
    """The force on the indenter as the gel, the arm's pose and the sensor's electronics make it.

    Until an arm has published a pose, the sensor hangs free.
    """

    def __init__(self, channel: ForceChannel, plant: Plant, world: SharedWorld) -> None:
        self._channel, self._plant, self._world = channel, plant, world

    def read(self, stamp_ns: int, *, hung_kg: float = 0.0) -> EmulatedForce:
        """Return the force for the newest pose of the arm; a weight pulls straight down."""
        rotation_vector, depth = _DOWN, -math.inf
        force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        state = self._world.read()
        if state.sequence > 0:
            rotation_vector = state.pose.rotation_vector
            force, torque = self._plant.wrench(state.pose, stamp_ns)
            depth = self._plant.depth(state.pose)
        load = (force[0], force[1], force[2] - hung_kg * GRAVITY_M_S2)
        return EmulatedForce(
            reading=self._channel.reading(load, torque, rotation_vector, stamp_ns),
            force_true_n=force[2],
            depth_true_m=depth if math.isfinite(depth) else None,
        )
