"""Which process talks to which: the sockets between them, and their start."""

from __future__ import annotations

import socket
from pathlib import Path

from protocols.processes.channel import Channel
from protocols.processes.launched import Launched
from protocols.processes.messages import Job
from protocols.programme import PlannedTrial
from tacauchy_rig.config.model import RigConfig

Ends = dict[str, dict[str, socket.socket | Channel]]


def launch_children(
    root: Path, config: RigConfig, plan: tuple[PlannedTrial, ...]
) -> dict[str, Launched]:
    """Start recorder, camera and control; return them by name.

    Every end is closed here once its owner has it, so that the death of a process shows to its
    partners as an end of file.
    """
    children: dict[str, Launched] = {}
    ends = _connect_all()
    try:
        for name, sockets in ends.items():
            job = Job(
                root=root,
                config=config,
                plan=plan,
                descriptors={what: end.fileno() for what, end in sockets.items()},
            )
            children[name] = Launched(name, job)
    finally:
        for sockets in ends.values():
            for end in sockets.values():
                end.close()
    return children


def _connect_all() -> Ends:
    control_data, recorder_control_data = socket.socketpair()
    camera_data, recorder_camera_data = socket.socketpair()
    control_acks, recorder_control_acks = Channel.pair()
    camera_acks, recorder_camera_acks = Channel.pair()
    control_status, camera_status = Channel.pair()
    return {
        "recorder": {
            "control-data": recorder_control_data,
            "control-acks": recorder_control_acks,
            "camera-data": recorder_camera_data,
            "camera-acks": recorder_camera_acks,
        },
        "camera": {
            "recorder-data": camera_data,
            "recorder-acks": camera_acks,
            "control-status": camera_status,
        },
        "control": {
            "recorder-data": control_data,
            "recorder-acks": control_acks,
            "camera-status": control_status,
        },
    }
