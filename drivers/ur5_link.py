"""The two ur_rtde interfaces of one arm: opened, read, called and closed within deadlines."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any, TypeVar

from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from drivers.ur5_commander import Commander
from drivers.ur5_guardian import Guardian
from drivers.ur5_safety import RuntimeState
from drivers.ur5_sockets import RtdeSockets
from tacauchy_rig.errors import DeviceError, RigError
from tacauchy_rig.run import ArmSample, Pose

_logger = logging.getLogger(__name__)
T = TypeVar("T")

RECORD_RATE_HZ = 125.0
_FIELDS = [
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "runtime_state",
    "safety_status_bits",
    "robot_mode",
]
_CONTROLLER_RATE = -1.0
_TORN_READS = 5
_FIRST_STATE_S = 1.0
_CLOSE_S = 5.0
_STOP_SCRIPT_S = 1.0


class UrLink:
    """Both interfaces of one controller; control calls go through one thread.

    Args:
        host: Name or address of the controller.
        timeout_s: How long ur_rtde's constructors may take before this process is ended [s].

    Raises:
        DeviceError: ur_rtde refused to connect, or no data came.
    """

    def __init__(self, host: str, *, timeout_s: float) -> None:
        self.device = f"robot {host}"
        self._commander = Commander(self.device)
        self._receive: Any = None
        self._control: Any = None
        self._sockets = RtdeSockets()
        try:
            with Guardian(f"{self.device}: connecting", timeout_s=timeout_s):
                self._receive = RTDEReceiveInterface(host, RECORD_RATE_HZ, _FIELDS)
                # External force input is never used here, and CB3 controllers lack it.
                flags = (
                    RTDEControlInterface.FLAG_UPLOAD_SCRIPT | RTDEControlInterface.FLAG_NO_EXT_FT
                )
                self._control = RTDEControlInterface(host, _CONTROLLER_RATE, flags)
        except (RuntimeError, ValueError) as error:
            self.close()
            raise DeviceError(
                f"{self.device}: the client library could not connect: {error}",
                remedy="see that nothing else drives the robot and that it is in remote control",
            ) from error
        self._sockets.remember(host)
        self._await_first_state()

    @property
    def is_unbroken(self) -> bool:
        """False once a connection was closed, or replaced behind our back."""
        return self._receive is not None and self._sockets.are_unchanged()

    @property
    def is_stuck(self) -> bool:
        """True once a control call missed its deadline."""
        return self._commander.is_stuck

    def sample(self) -> ArmSample:
        """Return the newest state, all of it from one data packet."""
        receive = self._receive
        for _ in range(_TORN_READS):
            time_s = receive.getTimestamp()
            x, y, z, rx, ry, rz = receive.getActualTCPPose()
            vx, vy, vz, wx, wy, wz = receive.getActualTCPSpeed()
            runtime_state = receive.getRuntimeState()
            safety_bits = receive.getSafetyStatusBits()
            robot_mode = receive.getRobotMode()
            if receive.getTimestamp() == time_s:
                break
        return ArmSample(
            stamp_ns=time.monotonic_ns(),
            controller_time_s=time_s,
            pose=Pose(position=(x, y, z), rotation_vector=(rx, ry, rz)),
            velocity=(vx, vy, vz, wx, wy, wz),
            runtime_state=runtime_state,
            safety_bits=safety_bits,
            robot_mode=robot_mode,
        )

    def call(self, activity: str, function: Callable[[Any], T], *, deadline_s: float) -> T:
        """Return ``function(control interface)``.

        Args:
            activity: What it does, for messages.
            function: Makes one call.
            deadline_s: How long to wait [s].

        Raises:
            DeviceError: No answer in time, the connection is closed, or the library complained.
        """
        control = self._control
        if control is None:
            raise DeviceError(f"{self.device}: {activity} is not possible, it is not connected")
        return self._commander.call(activity, lambda: function(control), deadline_s=deadline_s)

    def close(self) -> None:
        """End the program on the controller and disconnect; never raises."""
        with Guardian(f"{self.device}: disconnecting", timeout_s=_CLOSE_S):
            control = self._control
            # Over a broken connection there is nobody to tell, and the library would wait.
            if control is not None and self.is_unbroken and not self.is_stuck:
                try:
                    self._commander.call(
                        "ending the program",
                        control.stopScript,
                        deadline_s=_STOP_SCRIPT_S,
                    )
                except RigError as error:
                    _logger.warning("%s", error)
            # The destructors disconnect, each taking half a second.
            del control
            self._control = self._receive = None
        self._commander.close()

    def _await_first_state(self) -> None:
        end_s = time.monotonic() + _FIRST_STATE_S
        while True:
            sample = self.sample()
            if sample.controller_time_s > 0.0 and sample.runtime_state == RuntimeState.PLAYING:
                return
            if time.monotonic() > end_s:
                self.close()
                raise DeviceError(
                    f"{self.device}: its program did not start within {_FIRST_STATE_S:g} s",
                    remedy="read the pendant's message and log; is a program waiting there?",
                )
            time.sleep(0.005)
