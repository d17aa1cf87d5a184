"""A mock arm: moves in the mock world with a delay and finite acceleration."""

import math
from collections import deque
from typing import Self

from drivers.emulators.arm.coarse_force_estimate import ForceEstimate
from drivers.emulators.faults import STOPS, Device, Fault, FaultKind, SilentArmFaults
from drivers.interfaces import Clock, DeviceIdentity
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ArmSample, Pose, Vector6, vector6
from tests.mock.world import MockWorld, Still

ARRIVED_M = 1e-6
PLAYING, RUNNING = 2, 7
PROTECTIVE_STOPPED = 1 << 2


class MockArm:
    """Obeys ``drivers.interfaces.Arm`` without a wire.

    Faults it shows: freeze (states stop coming), stall (it stands still whatever it is told), the
    stops, and the silent ones of an arm.

    Attributes:
        refuses_poses: Whether its controller admits no pose.
        ignores_moves: Whether it takes moves and does not begin them.
    """

    def __init__(self, world: MockWorld) -> None:
        self.world = world
        self.refuses_poses = self.ignores_moves = False
        self.watchdog_stops = 0  # how often the watchdog had to stop the arm
        self.fastest_m_s = 0.0  # highest tool speed so far
        self._target: Pose | None = None
        self._speed = 0.0
        self._acceleration = world.config.robot.acceleration
        self._watchdog_ns = round(1e9 / world.config.robot.watchdog)
        self._commands: deque[tuple[int, Vector6]] = deque()
        self._wanted: Vector6 = Still
        self._kicked_ns = world.now_ns
        self._locked = False
        self._states: list[ArmSample] = []
        robot = world.config.robot
        self._period_ns = round(1e9 / robot.model.rate_hz)
        self._estimate = ForceEstimate(
            robot.model, seed=world.config.emulation.seed, sign=robot.force_sign
        )
        self._silent = SilentArmFaults()
        self._newest = self._sample(world.now_ns)
        self._next_ns = world.now_ns
        world.drive(self._velocity_after)
        world.on_step(self._report)
        world.on_fault.append(self._stop_or_unlock)

    @classmethod
    def from_config(cls, config: RigConfig) -> Self:
        """Return an arm in a world of its own on the host's clock, with its planned faults."""
        world = MockWorld(Clock(), config)
        arm = cls(world)
        world.plan(config.emulation.faults)
        return arm

    def connect(self) -> DeviceIdentity:
        """Answer at once."""
        self._kicked_ns = self.world.clock.now_ns()
        return DeviceIdentity(
            driver="mock",
            address="in process",
            model=f"mock UR5 {self.world.config.robot.model.value}",
            serial="0",
            simulated=True,
            settings={},
        )

    def state(self) -> ArmSample:
        """Return the newest state.

        Raises:
            DeviceError: The arm is frozen or in a protective stop.
        """
        self.world.catch_up()
        age_s = (self.world.now_ns - self._newest.stamp_ns) * 1e-9
        if FaultKind.FREEZE in self.world.faults_of(Device.ROBOT) and age_s > 0.05:
            raise DeviceError(f"robot: its time stamp has not moved for {age_s * 1e3:.0f} ms")
        if self._locked:
            raise DeviceError(
                "robot: protective stop (safety bit 2)",
                remedy="look at the arm, then unlock it on the pendant",
            )
        return self._newest

    def drain(self) -> list[ArmSample]:
        """Return the states since the last call."""
        self.world.catch_up()
        states, self._states = self._states, []
        return states

    def is_pose_allowed(self, pose: Pose) -> bool:
        """Admit every pose unless told to refuse."""
        return not self.refuses_poses and math.isfinite(pose.position[2])

    def start_move(self, target: Pose, *, speed: float, acceleration: float) -> None:
        """Start a straight move.

        Raises:
            DeviceError: The arm is locked.
        """
        self.state()
        if not self.ignores_moves:
            self._target = target.shifted(z=-self._silent.height_m)
            self._speed, self._acceleration = speed, acceleration

    def is_moving(self) -> bool:
        """Return True until the move has ended."""
        self.world.catch_up()
        return self._target is not None

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Set the velocity, effective after the world's motion delay.

        Raises:
            DeviceError: The arm is locked.
        """
        self.state()
        delay_ns = round(self.world.motion_delay_s * 1e9)
        self._commands.append((self.world.clock.now_ns() + delay_ns, velocity))
        self._target, self._acceleration = None, acceleration

    def kick_watchdog(self) -> None:
        """Remember that the program lives."""
        self._kicked_ns = self.world.clock.now_ns()

    def stop(self) -> None:
        """End any motion after the world's motion delay."""
        delay_ns = round(self.world.motion_delay_s * 1e9)
        self._commands.append((self.world.clock.now_ns() + delay_ns, Still))
        self._target = None

    def protective_stop(self) -> None:
        """Lock the arm; no program unlocks it."""
        self._locked = True
        self._target = None
        self._wanted = Still
        self._commands.clear()

    def unlock(self) -> None:
        """Do what a person does at the pendant after a stop."""
        self._locked = False

    def _stop_or_unlock(self, fault: Fault, begins: bool) -> None:
        if fault.kind in STOPS and begins:
            self.protective_stop()
        elif fault.kind in STOPS or (fault.kind is FaultKind.UNLOCK and begins):
            self.unlock()

    def close(self) -> None:
        """Stop."""
        self.stop()

    def _velocity_after(self, step_s: float) -> Vector6:
        now_ns = self.world.now_ns
        while self._commands and self._commands[0][0] <= now_ns:
            self._wanted = self._commands.popleft()[1]
        if self._locked or FaultKind.STALL in self.world.faults_of(Device.ROBOT):
            return Still
        wanted = self._wanted if self._target is None else self._towards_target(step_s)
        if wanted != Still and now_ns - self._kicked_ns > self._watchdog_ns:
            self.watchdog_stops += 1
            self.protective_stop()
            return Still
        old = self.world.velocity
        if wanted == old:
            return old
        most = max(self._acceleration * step_s, 1e-9)
        new = vector6(
            v if w == v else v + min(most, max(-most, w - v))
            for w, v in zip(wanted, old, strict=True)
        )
        self.fastest_m_s = max(self.fastest_m_s, math.hypot(*new[:3]))
        return new

    def _towards_target(self, step_s: float) -> Vector6:
        target = self._target
        if target is None:
            return Still
        to_x, to_y, to_z = target.position
        x, y, z = self.world.pose.position
        x, y, z = to_x - x, to_y - y, to_z - z
        distance = math.hypot(x, y, z)
        if distance < ARRIVED_M:
            self._target, self._wanted = None, Still
            self.world.velocity = Still
            return Still
        braking = math.sqrt(2.0 * 0.5 * self._acceleration * distance)
        speed = min(self._speed, braking, distance / step_s)
        return (x / distance * speed, y / distance * speed, z / distance * speed, 0.0, 0.0, 0.0)

    def _sample(self, stamp_ns: int) -> ArmSample:
        world, silent = self.world, self._silent
        pose, velocity, duration_s = world.reported_pose(), world.velocity, self._period_ns * 1e-9
        silent.advance(world.faults_of(Device.ROBOT).values(), velocity, duration_s=duration_s)
        return ArmSample(
            stamp_ns=stamp_ns,
            controller_time_s=(stamp_ns - world.start_ns) * 1e-9 + silent.clock_s,
            pose=pose.shifted(z=silent.height_m) if silent.height_m else pose,
            velocity=velocity,
            runtime_state=PLAYING,
            safety_bits=PROTECTIVE_STOPPED if self._locked else 1,
            robot_mode=RUNNING,
            tcp_force=self._estimate.advance(
                world.felt_by_arm(duration_s=duration_s), velocity, duration_s=duration_s
            ),
        )

    def _report(self, now_ns: int) -> None:
        if now_ns < self._next_ns or FaultKind.FREEZE in self.world.faults_of(Device.ROBOT):
            return
        self._next_ns = now_ns + self._period_ns
        self._newest = self._sample(now_ns)
        self._states.append(self._newest)
