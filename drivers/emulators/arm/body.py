"""What an emulated UR controller knows about itself: power, safety, payload, registers, motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from drivers.arm.ur5_safety import RobotMode, RuntimeState, SafetyBit
from drivers.arm.ur5_wire import INPUT_TYPES, OUTPUT_TYPES, TYPE_FORMATS, Value
from drivers.emulators.arm.motion import ToolMotion
from tacauchy_rig.core.config.model import RobotModel
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


@dataclass(slots=True)
class SafetyStatus:
    """Power and safety as the RTDE fields and the dashboard show them."""

    bits: int = SafetyBit.NORMAL
    mode: int = 1
    name: str = "NORMAL"
    robot_mode: int = RobotMode.RUNNING

    @property
    def admits_programs(self) -> bool:
        """True when a program may run."""
        return bool(self.bits & SafetyBit.NORMAL) and self.robot_mode == RobotMode.RUNNING

    def reset(self) -> None:
        """Do what a person does at the pendant: unlock, power on, release the brakes."""
        self.bits, self.mode, self.name = SafetyBit.NORMAL, 1, "NORMAL"
        self.robot_mode = RobotMode.RUNNING

    def protective_stop(self) -> None:
        """Enter a protective stop."""
        self.bits = SafetyBit.PROTECTIVE_STOP | SafetyBit.STOPPED_FOR_SAFETY
        self.mode, self.name = 3, "PROTECTIVE_STOP"

    def emergency_stop(self) -> None:
        """Enter an emergency stop; the arm loses its power."""
        self.bits = (
            SafetyBit.ROBOT_EMERGENCY_STOP | SafetyBit.EMERGENCY_STOP | SafetyBit.STOPPED_FOR_SAFETY
        )
        self.mode, self.name = 7, "ROBOT_EMERGENCY_STOP"
        self.robot_mode = RobotMode.POWER_OFF


def _zero(type_name: str) -> Value:
    layout = TYPE_FORMATS[type_name]
    return (0,) * int(layout[:-1] or "1")


@dataclass(slots=True)
class ControllerBody:
    """Everything that the ports of one emulated controller share.

    Attributes:
        outputs: Value of each RTDE output field, always a tuple.
        inputs: Value of each RTDE input field that a client wrote.
        runtime_state: State of the program.
        remote_control: False when the pendant is in local control.
        zero_ft_asked: ``zero_ftsensor`` came and has not been applied yet.
    """

    model: RobotModel
    motion: ToolMotion
    remote_control: bool = True
    safety: SafetyStatus = field(default_factory=SafetyStatus)
    runtime_state: int = RuntimeState.STOPPED
    tcp_offset: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    payload_kg: float = 0.0
    zero_ft_asked: bool = False
    outputs: dict[str, Value] = field(default_factory=dict)
    inputs: dict[str, Value] = field(default_factory=dict)

    @classmethod
    def at_home(
        cls, model: RobotModel, home: Pose, *, remote_control: bool = True
    ) -> ControllerBody:
        """Return a powered, idle controller with the tip at ``home``."""
        body = cls(model=model, motion=ToolMotion(home), remote_control=remote_control)
        names = [
            name
            for name in OUTPUT_TYPES
            if model is RobotModel.E_SERIES or name not in _E_SERIES_ONLY
        ]
        body.outputs = {name: _zero(OUTPUT_TYPES[name]) for name in names}
        body.inputs = {name: _zero(type_name) for name, type_name in INPUT_TYPES.items()}
        body.outputs |= {
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
        return body

    def put_int(self, register: int, value: int) -> None:
        """Write an integer output register."""
        self.outputs[f"output_int_register_{register}"] = (value,)

    def put_doubles(self, first: int, values: tuple[float, ...]) -> None:
        """Write consecutive double output registers."""
        for number, value in enumerate(values, start=first):
            self.outputs[f"output_double_register_{number}"] = (value,)

    def get_int(self, register: int) -> int:
        """Read an integer input register."""
        return int(self.inputs[f"input_int_register_{register}"][0])

    def get_doubles(self, first: int, count: int) -> tuple[float, ...]:
        """Read consecutive double input registers."""
        return tuple(
            self.inputs[f"input_double_register_{first + number}"][0] for number in range(count)
        )

    def admits_pose(self, pose: Vector6) -> bool:
        """Return whether a tip pose lies within a coarse model of the arm's reach."""
        x, y, z = pose[:3]
        from_shoulder = math.hypot(x, y, z - _SHOULDER_Z_M)
        return from_shoulder <= _REACH_M and math.hypot(x, y) >= _COLUMN_M

    def publish(
        self, *, time_s: float, pose: Vector6, velocity: Vector6, tcp_force: Vector6
    ) -> None:
        """Bring the RTDE output fields up to date.

        Args:
            time_s: The controller's time stamp [s].
            pose: Tip pose as the encoders report it [m, rad].
            velocity: Tip velocity [m/s, rad/s].
            tcp_force: What the arm takes for force [N] and moment [N m] on its tip.
        """
        outputs, safety = self.outputs, self.safety
        outputs["timestamp"] = (time_s,)
        outputs["actual_TCP_pose"] = pose
        outputs["target_TCP_pose"] = self.motion.pose
        outputs["actual_TCP_speed"] = velocity
        outputs["target_TCP_speed"] = velocity
        outputs["actual_TCP_force"] = tcp_force
        outputs["tcp_force_scalar"] = (math.hypot(*tcp_force[:3]),)
        running = self.runtime_state == RuntimeState.PLAYING
        powered = safety.robot_mode >= RobotMode.POWER_ON
        self._put("runtime_state", self.runtime_state)
        self._put("robot_status_bits", (1 if powered else 0) | (2 if running else 0))
        self._put("safety_status_bits", int(safety.bits))
        self._put("safety_mode", safety.mode)
        self._put("safety_status", safety.mode)
        self._put("robot_mode", int(safety.robot_mode))
        self._put("payload", self.payload_kg)
        if outputs["tcp_offset"] != self.tcp_offset:
            outputs["tcp_offset"] = self.tcp_offset

    def _put(self, name: str, value: float) -> None:
        # Keep the old object where nothing changed, so that packing can skip it.
        if self.outputs[name][0] != value:
            self.outputs[name] = (value,)
