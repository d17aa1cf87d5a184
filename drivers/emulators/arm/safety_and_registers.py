"""What an emulated UR controller knows of itself: power, safety, reach, registers."""

import math
from dataclasses import dataclass

from drivers.arm.ur5_rtde import (
    INPUT_TYPES,
    OUTPUT_TYPES,
    TYPE_FORMATS,
    RobotMode,
    RuntimeState,
    SafetyBit,
    Value,
)
from drivers.emulators.arm.tool_motion import STILL, ToolMotion
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.run import Pose, Vector6

VERSIONS: dict[RobotModel, tuple[int, int, int, int]] = {
    RobotModel.CB3: (3, 15, 8, 106339),
    RobotModel.E_SERIES: (5, 11, 1, 108318),
}

# What a program's end and a safety stop ask of the arm [m/s^2]; a real arm's figures depend on
# its joints, and are of this size.
PROGRAM_END_DECELERATION = 1.5
SAFETY_STOP_DECELERATION = 3.0

_E_SERIES_ONLY = ("ft_raw_wrench", "actual_current_as_torque")
_RESTING_JOINTS: Vector6 = (0.0, -1.5708, -1.5708, -1.5708, 1.5708, 0.0)
# Reach of the tip measured from the shoulder, and how near the base column it may come [m].
_REACH_M, _SHOULDER_Z_M, _COLUMN_M = 1.05, 0.089, 0.12


@dataclass(frozen=True, slots=True)
class Safety:
    """Power and safety as the RTDE fields and the dashboard show them."""

    name: str
    mode: int
    bits: int
    robot_mode: RobotMode = RobotMode.RUNNING


NORMAL = Safety("NORMAL", 1, SafetyBit.NORMAL)
PROTECTIVE_STOP = Safety(
    "PROTECTIVE_STOP", 3, SafetyBit.PROTECTIVE_STOP | SafetyBit.STOPPED_FOR_SAFETY
)
EMERGENCY_STOP = Safety(  # the arm loses its power
    "ROBOT_EMERGENCY_STOP",
    7,
    SafetyBit.ROBOT_EMERGENCY_STOP | SafetyBit.EMERGENCY_STOP | SafetyBit.STOPPED_FOR_SAFETY,
    RobotMode.POWER_OFF,
)


def _zero(type_name: str) -> Value:
    return (0,) * int(TYPE_FORMATS[type_name][:-1] or "1")


class ControllerBody:
    """Everything that the ports of one emulated controller share; powered and idle at first."""

    def __init__(self, model: RobotModel, home: Pose, *, remote_control: bool = True) -> None:
        self.model = model
        self.motion = ToolMotion(home)
        self.remote_control = remote_control  # false when the pendant is in local control
        self.safety = NORMAL
        self.runtime_state: int = RuntimeState.STOPPED
        self.tcp_offset = STILL
        self.payload_kg = 0.0
        self.zero_ft_asked = False  # ``zero_ftsensor`` came and has not been applied yet
        # Value of each RTDE input field that a client wrote.
        self.inputs = {name: _zero(type_name) for name, type_name in INPUT_TYPES.items()}
        # Value of each RTDE output field, always a tuple.
        self.outputs = {
            name: _zero(type_name)
            for name, type_name in OUTPUT_TYPES.items()
            if model is RobotModel.E_SERIES or name not in _E_SERIES_ONLY
        }
        self.outputs |= {
            "actual_q": _RESTING_JOINTS,
            "target_q": _RESTING_JOINTS,
            "joint_mode": (253,) * 6,
            "joint_temperatures": (29.0,) * 6,
            "actual_joint_voltage": (48.0,) * 6,
            "speed_scaling": (1.0,),
            "target_speed_fraction": (1.0,),
            "actual_main_voltage": (48.0,),
            "actual_robot_voltage": (48.0,),
            "actual_robot_current": (0.6,),
            "actual_tool_accelerometer": (0.0, 0.0, 9.82),
        }

    @property
    def is_playing(self) -> bool:
        """Whether a program runs."""
        return self.runtime_state == RuntimeState.PLAYING

    def admits_pose(self, pose: Vector6) -> bool:
        """Return whether a tip pose lies within a coarse model of the arm's reach."""
        x, y, z = pose[:3]
        from_shoulder = math.hypot(x, y, z - _SHOULDER_Z_M)
        return from_shoulder <= _REACH_M and math.hypot(x, y) >= _COLUMN_M

    def publish(self, *, time_s: float, tcp_force: Vector6) -> None:
        """Bring the RTDE output fields up to date.

        Args:
            tcp_force: What the arm takes for force [N] and moment [N m] on its tip.
        """
        safety, pose, velocity = self.safety, self.motion.pose, self.motion.velocity
        is_powered = safety.robot_mode >= RobotMode.POWER_ON
        self.outputs |= {
            "timestamp": (time_s,),
            "actual_TCP_pose": pose,
            "target_TCP_pose": pose,
            "actual_TCP_speed": velocity,
            "target_TCP_speed": velocity,
            "actual_TCP_force": tcp_force,
            "tcp_force_scalar": (math.hypot(*tcp_force[:3]),),
            "runtime_state": (self.runtime_state,),
            "robot_status_bits": (is_powered | self.is_playing << 1,),
            "safety_status_bits": (safety.bits,),
            "safety_mode": (safety.mode,),
            "safety_status": (safety.mode,),
            "robot_mode": (safety.robot_mode,),
            "payload": (self.payload_kg,),
            "tcp_offset": self.tcp_offset,
        }
