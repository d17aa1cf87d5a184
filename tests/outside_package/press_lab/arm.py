"""A laboratory's arm: here one that exists in this file alone, moved by its own clock.

A real one would talk to its controller where this one computes; what it answers is the same.
"""

import math
import time
from collections import deque
from typing import Self

from drivers.interfaces import DeviceIdentity
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ArmSample, Pose, Vector3, Vector6

_STILL: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_PLAYING, _NORMAL, _RUNNING = 2, 1, 7  # as the record tells a fit arm, whoever built it
_ARRIVED_M = 1e-6


class LabArm:
    """Obeys ``drivers.interfaces.Arm``."""

    def __init__(self, home: Pose, *, cycle_hz: float, watchdog_hz: float) -> None:
        self._pose, self._period_s, self._watchdog_s = home, 1.0 / cycle_hz, 1.0 / watchdog_hz
        self._time_s = self._fed_s = time.monotonic()
        self._velocity = _STILL
        self._target: tuple[Vector3, float] | None = None
        self._lost = ""
        self._record: deque[ArmSample] = deque(maxlen=10_000)

    @classmethod
    def from_config(cls, config: RigConfig) -> Self:
        """Return the arm that ``[robot]`` describes; ``cycle_hz`` is an option of its own."""
        robot = config.robot
        home = Pose(position=robot.home, rotation_vector=robot.tool_rotation)
        cycle_hz = float(robot.options.get("cycle_hz", 200))
        return cls(home, cycle_hz=cycle_hz, watchdog_hz=robot.watchdog)

    def connect(self) -> DeviceIdentity:
        """Answer at once."""
        self._time_s = self._fed_s = time.monotonic()
        return DeviceIdentity(
            driver="press-lab-arm",
            address="this process",
            model="arm of the press lab",
            serial="1",
            simulated=True,
            settings={"cycle_hz": f"{1.0 / self._period_s:g}"},
        )

    def state(self) -> ArmSample:
        """Return the newest state."""
        self._catch_up()
        if self._lost:
            raise DeviceError(f"lab arm: {self._lost}", remedy="look at the arm, start again")
        sample = ArmSample(
            stamp_ns=time.monotonic_ns(),
            controller_time_s=self._time_s,
            pose=self._pose,
            velocity=self._velocity,
            runtime_state=_PLAYING,
            safety_bits=_NORMAL,
            robot_mode=_RUNNING,
        )
        if not self._record or self._record[-1].controller_time_s < self._time_s:
            self._record.append(sample)
        return sample

    def drain(self) -> list[ArmSample]:
        """Return the states since the last call."""
        samples = list(self._record)
        self._record.clear()
        return samples

    def is_pose_allowed(self, pose: Pose) -> bool:
        """Admit what is within reach."""
        return math.hypot(*pose.position) < 1.0

    def start_move(self, target: Pose, *, speed: float, acceleration: float) -> None:
        """Start a straight move; this arm needs no time to speed up."""
        del acceleration
        self.state()
        self._target = (target.position, speed)

    def is_moving(self) -> bool:
        """Return True until the move has ended."""
        self._catch_up()
        return self._target is not None

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Set the tool velocity."""
        del acceleration
        self.state()
        self._fed_s = self._time_s
        self._target, self._velocity = None, velocity

    def kick_watchdog(self) -> None:
        """Remember that the program lives."""
        self._catch_up()
        self._fed_s = time.monotonic()

    def stop(self) -> None:
        """End any motion."""
        self._catch_up()
        self._target, self._velocity = None, _STILL

    def protective_stop(self) -> None:
        """Lock the arm."""
        self.stop()
        self._lost = "protective stop"

    def close(self) -> None:
        """Stop."""
        self.stop()

    def _catch_up(self) -> None:
        now_s = time.monotonic()
        while self._time_s + self._period_s <= now_s:
            self._time_s += self._period_s
            if self._time_s - self._fed_s > self._watchdog_s and self._moves:
                self._target, self._velocity = None, _STILL
                self._lost = "its program was not fed"
            self._step()

    @property
    def _moves(self) -> bool:
        return self._target is not None or self._velocity != _STILL

    def _step(self) -> None:
        if self._target is not None:
            goal, speed = self._target
            way = [g - p for g, p in zip(goal, self._pose.position, strict=True)]
            distance_m = math.hypot(*way)
            if distance_m < _ARRIVED_M:
                self._target, self._velocity = None, _STILL
                return
            pace = min(speed, distance_m / self._period_s)
            vx, vy, vz = (w / distance_m * pace for w in way)
            self._velocity = (vx, vy, vz, 0.0, 0.0, 0.0)
        x, y, z = (v * self._period_s for v in self._velocity[:3])
        self._pose = self._pose.shifted(x=x, y=y, z=z)
