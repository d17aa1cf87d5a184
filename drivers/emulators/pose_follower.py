"""Let an emulated sensor or camera follow a robot that is not emulated with it.

A process of its own: it subscribes to the robot's reported tool pose through ur_rtde, as any
client may, and publishes it to the emulated world. It never commands anything.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

from rtde_receive import RTDEReceiveInterface

from drivers.arm.ur5_probe import probe_controller
from drivers.emulators.shared_world import SharedWorld, WorldWriter
from tacauchy_rig.errors import DeviceError, RigError
from tacauchy_rig.run import Pose, Vector6

POLL_S = 0.004
STALE_S = 0.5


def follow(
    host: str, world_path: Path, *, parent_pid: int | None = None, timeout_s: float = 10.0
) -> None:
    """Publish the pose that the controller at ``host`` reports until it falls silent.

    Raises:
        DeviceError: The controller is unreachable, or its time stamp stopped moving for 0.5 s.
    """
    probe_controller(host, timeout_s=timeout_s)
    receiver = RTDEReceiveInterface(
        host, -1.0, ["timestamp", "actual_TCP_pose", "actual_TCP_speed"]
    )
    world = SharedWorld.create(world_path)
    world.claim(WorldWriter.REPORTED_POSE)
    print(json.dumps({"device": "pose_follower", "host": host}), flush=True)
    newest, moved = receiver.getTimestamp(), time.monotonic()
    while parent_pid is None or os.getppid() == parent_pid:
        stamp, now = receiver.getTimestamp(), time.monotonic()
        if stamp != newest:
            newest, moved = stamp, now
            pose = _vector(receiver.getActualTCPPose())
            velocity = _vector(receiver.getActualTCPSpeed())
            reported = Pose(position=pose[:3], rotation_vector=pose[3:])
            world.publish(reported, velocity, time.monotonic_ns())
        elif now - moved > STALE_S:
            raise DeviceError(
                f"robot {host}: no new state for {STALE_S * 1e3:.0f} ms",
                remedy="the emulated devices beside it have stopped too; start the run again",
            )
        time.sleep(POLL_S)


def _vector(values: list[float]) -> Vector6:
    x, y, z, rx, ry, rz = values
    return (x, y, z, rx, ry, rz)


def main() -> None:
    """Run as a process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", required=True)
    parser.add_argument("--world", type=Path, required=True)
    parser.add_argument("--parent-pid", type=int, help="end when this parent process ends")
    arguments = parser.parse_args()
    try:
        follow(arguments.host, arguments.world, parent_pid=arguments.parent_pid)
    except RigError as error:
        sys.exit(f"pose follower: {error}")


if __name__ == "__main__":
    main()
