"""What an emulated UR controller knows of itself: power, safety, reach, registers, motion."""

import math
from dataclasses import dataclass

from drivers.arm import ur5_rtde as rtde
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.rotations import composed
from tacauchy_rig.core.run import Pose, Vector3, Vector6, vector6

STILL: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ARRIVED_M = 1e-9
# A turn without travel is driven as if its angle were travelled at this lever arm.
_LEVER_ARM_M = 0.5


class ToolMotion:
    """The tip's pose and velocity, advanced cycle by cycle, in Cartesian space only.

    Three ways to move exclude one another: along a line to a target, at a set velocity, and
    braking to a stop.
    """

    def __init__(self, home: Pose) -> None:
        self.pose: Vector6 = home.as_vector()  # x, y, z [m] and rotation vector [rad] of the tip
        self.velocity: Vector6 = STILL  # tool velocity [m/s, rad/s]
        # While True the arm stands still whatever it was told (an injected fault).
        self.stalled = False
        self._target: Vector6 | None = None
        self._target_velocity: Vector6 | None = None
        self._speed_cap = self._acceleration = self._speed = 0.0

    @property
    def is_still(self) -> bool:
        """True when nothing moves and nothing is meant to."""
        return self._target is None and self._target_velocity is None

    def move_to(self, target: Vector6, *, speed: float, acceleration: float) -> None:
        """Drive straight to ``target`` with a trapezoidal speed [m/s, m/s^2]."""
        self._target, self._target_velocity = target, None
        self._speed_cap, self._acceleration, self._speed = speed, acceleration, 0.0

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Approach ``velocity`` [m/s, rad/s] at ``acceleration`` [m/s^2, rad/s^2] and hold it."""
        self._target, self._target_velocity = None, velocity
        self._acceleration = acceleration

    def brake(self, deceleration: float) -> None:
        """Come to rest at ``deceleration`` [m/s^2]."""
        if not self.is_still:
            self.set_velocity(STILL, acceleration=deceleration)

    def step(self, duration_s: float) -> None:
        """Advance by ``duration_s`` [s]."""
        if self.is_still:
            return
        if self.stalled:
            self.velocity = STILL
            if self._target_velocity == STILL:
                self._target_velocity = None
        elif self._target is not None:
            self._approach(self._target, duration_s)
        elif self._target_velocity is not None:
            self._follow(self._target_velocity, duration_s)

    def _approach(self, target: Vector6, duration_s: float) -> None:
        x, y, z, a, b, c = self.pose
        turn: Vector3 = (0.0, 0.0, 0.0)
        if target[3:] != (a, b, c):
            turn = composed(target[3:], (-a, -b, -c))
        way = (target[0] - x, target[1] - y, target[2] - z, *turn)
        left = max(math.hypot(*way[:3]), _LEVER_ARM_M * math.hypot(*turn))
        braking = math.sqrt(2.0 * self._acceleration * left)
        new = min(self._speed + self._acceleration * duration_s, self._speed_cap, braking)
        step = 0.5 * (self._speed + new) * duration_s
        self._speed = new
        if step >= left - _ARRIVED_M:
            self.pose, self.velocity, self._target = target, STILL, None
            return
        self._travel(way, step / left)
        self.velocity = vector6(new / left * each for each in way)

    def _follow(self, target: Vector6, duration_s: float) -> None:
        v, limit = self.velocity, self._acceleration * duration_s
        change = [t - now for t, now in zip(target, v, strict=True)]
        sizes = (math.hypot(*change[:3]), math.hypot(*change[3:]))
        shares = [1.0 if size <= limit else limit / size for size in sizes for _ in range(3)]
        rows = zip(v, shares, change, strict=True)
        self.velocity = new = vector6(now + share * step for now, share, step in rows)
        # The mean of old and new velocity makes the travelled distance exact for a ramp.
        both = vector6(was + now for was, now in zip(v, new, strict=True))
        self._travel(both, 0.5 * duration_s)
        if target == STILL and not any(new):
            self._target_velocity = None

    def _travel(self, way: Vector6, share: float) -> None:
        """Go a share of a way [m, rad]."""
        x, y, z, a, b, c = self.pose
        dx, dy, dz, *turn = (share * each for each in way)
        rotation: Vector3 = (a, b, c)
        if any(turn):
            rotation = composed((turn[0], turn[1], turn[2]), rotation)
        self.pose = (x + dx, y + dy, z + dz, *rotation)


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
    robot_mode: rtde.RobotMode = rtde.RobotMode.RUNNING


NORMAL = Safety("NORMAL", 1, rtde.SafetyBit.NORMAL)
PROTECTIVE_STOP = Safety(
    "PROTECTIVE_STOP", 3, rtde.SafetyBit.PROTECTIVE_STOP | rtde.SafetyBit.STOPPED_FOR_SAFETY
)
EMERGENCY_STOP = Safety(  # the arm loses its power
    "ROBOT_EMERGENCY_STOP",
    7,
    rtde.SafetyBit.ROBOT_EMERGENCY_STOP
    | rtde.SafetyBit.EMERGENCY_STOP
    | rtde.SafetyBit.STOPPED_FOR_SAFETY,
    rtde.RobotMode.POWER_OFF,
)


def _zero(type_name: str) -> rtde.Value:
    return (0,) * int(rtde.TYPE_FORMATS[type_name][:-1] or "1")


class ControllerBody:
    """Everything that the ports of one emulated controller share; powered and idle at first."""

    def __init__(self, model: RobotModel, home: Pose, *, remote_control: bool = True) -> None:
        self.model = model
        self.motion = ToolMotion(home)
        self.remote_control = remote_control  # false when the pendant is in local control
        self.safety = NORMAL
        self.runtime_state: int = rtde.RuntimeState.STOPPED
        self.tcp_offset = STILL
        self.payload_kg = 0.0
        self.zero_ft_asked = False  # ``zero_ftsensor`` came and has not been applied yet
        # Value of each RTDE input field that a client wrote.
        self.inputs = {name: _zero(type_name) for name, type_name in rtde.INPUT_TYPES.items()}
        # Value of each RTDE output field, always a tuple.
        self.outputs = {
            name: _zero(type_name)
            for name, type_name in rtde.OUTPUT_TYPES.items()
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
        return self.runtime_state == rtde.RuntimeState.PLAYING

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
        is_powered = safety.robot_mode >= rtde.RobotMode.POWER_ON
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
