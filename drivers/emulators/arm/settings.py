"""How an emulated UR controller is told what to be: its command line."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.config.model import RobotModel
from tacauchy_rig.run import Pose

_PURPOSE = "An emulated UR controller; real ur_rtde clients connect to it."


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerSettings:
    """How one emulated controller is set up.

    Attributes:
        host: Loopback address to listen on; one controller for each address.
        folder: Where its world, trace, events and control socket lie.
        home: Pose of the tip at the start.
        repeatability_m: The true tip ends each move within this distance of the reported one.
        pose_noise_m: Standard deviation of the reported position.
        parent_pid: Ends with this process; None to serve until told otherwise.
    """

    host: str
    model: RobotModel
    folder: Path
    home: Pose
    seed: int = 0
    remote_control: bool = True
    repeatability_m: float = 0.0
    pose_noise_m: float = 0.0
    parent_pid: int | None = None


def parse_arguments(arguments: list[str]) -> ControllerSettings:
    """Return the settings that a command line asks for."""
    parser = argparse.ArgumentParser(prog="ur_controller", description=_PURPOSE)
    parser.add_argument("--host", default="127.0.0.5", help="loopback address to listen on")
    parser.add_argument(
        "--model", type=RobotModel, choices=list(RobotModel), default=RobotModel.E_SERIES
    )
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--home", default="0.3,-0.3,0.2,3.14159265,0,0", help="x,y,z,rx,ry,rz")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--local-control", action="store_true", help="not in remote control")
    parser.add_argument("--repeatability-m", type=float, default=0.0)
    parser.add_argument("--pose-noise-m", type=float, default=0.0)
    parser.add_argument("--parent-pid", type=int, help="end when this parent process ends")
    given = parser.parse_args(arguments)
    try:
        x, y, z, rx, ry, rz = (float(part) for part in given.home.split(","))
    except ValueError:
        parser.error(f"--home {given.home!r}: six numbers x,y,z,rx,ry,rz in m and rad are needed")
    return ControllerSettings(
        host=given.host,
        model=given.model,
        folder=given.folder,
        home=Pose(position=(x, y, z), rotation_vector=(rx, ry, rz)),
        seed=given.seed,
        remote_control=not given.local_control,
        repeatability_m=given.repeatability_m,
        pose_noise_m=given.pose_noise_m,
        parent_pid=given.parent_pid,
    )
