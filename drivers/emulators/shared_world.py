"""Where the arm is and which gel it presses, shared by processes that were started separately.

One writer (the emulated controller, or a follower of a real robot's reported pose) and any
number of readers (the emulated force sensor and camera) open the same small file. Readers poll;
nothing is queued and nothing is remembered but the newest state.

Each state is written by one call of the kernel, which no kill leaves half done, and carries a
checksum: a reader that met a write in between reads again. No state is ever torn.
"""

import json
import os
import struct
import sys
import time
import zlib
from pathlib import Path
from typing import NamedTuple, Self

from rtde_receive import RTDEReceiveInterface

from drivers.arm.ur5_controller_check import probe_controller
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import TRUTH_FILE, CylinderTip, SphereTip, Tip, read_truth
from drivers.emulators.process import DeviceSettings, own_settings
from tacauchy_rig.core.config.settings import IndenterKind
from tacauchy_rig.core.errors import DeviceError, RigError
from tacauchy_rig.core.run import Pose
from tacauchy_rig.core.store.atomic_write import write_atomically

WORLD_FILE = "world.bin"

_STATE = struct.Struct("=2q6d")  # sequence, stamp, pose
_CHECKSUM = struct.Struct("=q")
_FILE_SIZE = _STATE.size + _CHECKSUM.size
_READ_TRIES = 1000
_AGAIN_S = 1e-5  # the kernel may have let another process go first in the middle of a write


class WorldState(NamedTuple):
    """The newest state of the arm."""

    pose: Pose  # true pose of the tip [m, rad]; zero while nothing was published
    stamp_ns: int  # CLOCK_MONOTONIC of the moment the pose belongs to
    sequence: int  # number of states published so far; 0 means that none was


class SharedWorld:
    """A file that holds the newest state of the arm."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file() or path.stat().st_size != _FILE_SIZE:
            raise DeviceError(
                f"shared world {path}: absent, or not a file of this program",
                remedy="start the emulated devices from one command, with the same folder",
            )
        self._file = os.open(path, os.O_RDWR)
        self._sequence: int | None = None

    @classmethod
    def create(cls, path: Path) -> Self:
        """Create the file, or adopt the one that a previous process left there."""
        try:
            return cls(path)
        except DeviceError:
            write_atomically(path, _sealed(bytes(_STATE.size)))
            return cls(path)

    def publish(self, pose: Pose, stamp_ns: int) -> None:
        """Make a state the newest one, in the sequence of whoever published before."""
        before = self.read().sequence if self._sequence is None else self._sequence
        self._sequence = before + 1
        state = _STATE.pack(self._sequence, stamp_ns, *pose.as_vector())
        os.pwrite(self._file, _sealed(state), 0)

    def read(self) -> WorldState:
        """Return the newest state.

        Raises:
            DeviceError: No read was complete, so the file was damaged.
        """
        for _ in range(_READ_TRIES):
            data = os.pread(self._file, _FILE_SIZE, 0)
            state = data[: _STATE.size]
            if data == _sealed(state):
                sequence, stamp_ns, *v = _STATE.unpack(state)
                return WorldState(Pose.of(v), stamp_ns, sequence)
            time.sleep(_AGAIN_S)
        raise DeviceError(
            f"shared world {self.path}: no complete state in {_READ_TRIES} reads",
            remedy="the file was damaged: delete it and start the emulated devices again",
        )

    def close(self) -> None:
        """Close the file; it stays on disk for the others."""
        os.close(self._file)


def _sealed(state: bytes) -> bytes:
    return state + _CHECKSUM.pack(zlib.crc32(state))


POLL_S = 0.004
STALE_S = 0.5
_PROBE_S = 10.0


def follow(settings: DeviceSettings) -> None:
    """Publish the pose that a controller reports until it falls silent.

    Raises:
        DeviceError: The controller is unreachable, or its time stamp stopped moving for 0.5 s.
    """
    host, parent_pid = settings.host, settings.parent_pid
    probe_controller(host, timeout_s=_PROBE_S)
    receiver = RTDEReceiveInterface(host, -1.0, ["timestamp", "actual_TCP_pose"])
    world = SharedWorld.create(settings.folder / WORLD_FILE)
    print(json.dumps({"device": "pose_follower", "host": host}), flush=True)
    newest, moved = receiver.getTimestamp(), time.monotonic()
    while parent_pid is None or os.getppid() == parent_pid:
        stamp, now = receiver.getTimestamp(), time.monotonic()
        if stamp != newest:
            newest, moved = stamp, now
            world.publish(Pose.of(receiver.getActualTCPPose()), time.monotonic_ns())
        elif now - moved > STALE_S:
            raise DeviceError(
                f"robot {host}: no new state for {STALE_S * 1e3:.0f} ms",
                remedy="the emulated devices beside it have stopped too; start the run again",
            )
        time.sleep(POLL_S)


def plant_of(settings: DeviceSettings) -> Plant:
    """Return the gel of a rig, at rest.

    Raises:
        RecordError: Its truth is not written, or cannot be read.
    """
    config = settings.config
    indenter = config.indenter
    tip: Tip = SphereTip(diameter_m=indenter.diameter)
    if indenter.kind is IndenterKind.CYLINDER:
        tip = CylinderTip(diameter_m=indenter.diameter, fillet_m=indenter.fillet)
    return Plant(read_truth(settings.folder / TRUTH_FILE), tip, config.sensor.surface)


if __name__ == "__main__":
    try:
        follow(own_settings())
    except RigError as error:
        sys.exit(f"pose follower: {error}")
