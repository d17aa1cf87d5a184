"""A UR5 arm (CB3 or e-Series) driven through ur_rtde."""

import logging
import math
import time
from collections import deque

from drivers.arm.ur5_connection import LineMove, UrLink
from drivers.arm.ur5_controller_check import probe_controller, require_ready
from drivers.arm.ur5_rtde import safety_reason
from drivers.interfaces import DeviceIdentity
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError, SafetyError
from tacauchy_rig.core.run import ArmSample, Pose, Vector6

_logger = logging.getLogger(__name__)

_FEED_S = 0.25
_STOP_S = 0.15
_POLL_S = 0.002
_RECORD_LIMIT = 100_000
_CENTRE_OF_GRAVITY_M = [0.0, 0.0, 0.0]  # of the payload, in the flange frame
_CAP_ROUNDING = 1.0 + 1e-9
_TURN_SPEED_CAP_RAD_S = 0.2
_STOP_DECELERATION_M_S2 = 1.0


class Ur5:
    """One arm. One owner, one thread; best a process of its own, ended after any DeviceError.

    After any loss (silent controller, broken connection, ended program) the arm counts as lost:
    every further call raises the same error, nothing reconnects, and a person starts again. The
    controller's watchdog stops the arm when nobody calls ``kick_watchdog`` or ``set_velocity``
    at ``robot.watchdog``; it is armed by the first motion and stays armed. Motion beyond the
    largest speed and the acceleration of ``[robot]`` is refused here, whatever the caller checked.

    Args:
        config: Address, model and limits; an emulated arm is this one at its address.
    """

    def __init__(self, config: RigConfig) -> None:
        robot = config.robot
        self._robot = robot
        self._device = f"robot {robot.host}"
        self._speed_cap_m_s = max(
            robot.approach_speed, robot.search_speed, robot.press_speed, robot.retract_speed
        )
        self._stale_limit_s = config.limits.stale_robot
        self._tcp_offset = (*robot.tcp_offset, 0.0, 0.0, 0.0)
        self._link: UrLink | None = None
        self._watchdog_armed = False
        self._velocity: tuple[Vector6, float] | None = None  # set, with its acceleration
        self._line: LineMove | None = None
        self._record: deque[ArmSample] = deque(maxlen=_RECORD_LIMIT)

    def connect(self) -> DeviceIdentity:
        """Probe the controller, then let ur_rtde connect, each with a deadline.

        Raises:
            DeviceError: Unreachable, another model, in local control, not powered, stopped for
                safety, in use, or silent.
        """
        robot = self._robot
        report = probe_controller(robot.host, timeout_s=robot.connect_timeout)
        require_ready(report, model=robot.model)
        self._link = UrLink(robot, stale_limit_s=self._stale_limit_s)
        self._line, self._velocity, self._watchdog_armed = None, None, False
        try:
            offset, payload = list(self._tcp_offset), robot.payload
            self._link.command("setting the tool centre point", lambda c: c.setTcp(offset))
            self._link.command(
                "setting the payload", lambda c: c.setPayload(payload, _CENTRE_OF_GRAVITY_M)
            )
            self.state()
        except DeviceError:
            self.close()
            raise
        return DeviceIdentity(
            driver="ur5",
            address=robot.host,
            model=f"UR5 {report.model.value}",
            serial=report.serial,
            simulated=robot.is_emulated,
            settings={
                "controller_version": report.version_text,
                "tcp_offset": str(self._tcp_offset),
                "payload_kg": str(robot.payload),
                "watchdog_hz": str(robot.watchdog),
                "stale_limit_s": str(self._stale_limit_s),
            },
        )

    def state(self) -> ArmSample:
        """Return the newest state; an error says what the controller tells of it. See ``Arm``."""
        sample, is_new = self._require_link().state()
        if is_new:
            self._record.append(sample)
        return sample

    def drain(self) -> list[ArmSample]:
        """Return the states that ``state`` saw since the last call, oldest first, none twice."""
        samples = list(self._record)
        self._record.clear()
        return samples

    def is_pose_allowed(self, pose: Pose) -> bool:
        """Ask the controller whether its safety limits admit ``pose``; see ``Arm``."""
        vector = list(pose.as_vector())
        allowed = self._require_link().call(
            "checking a pose", lambda c: bool(c.isPoseWithinSafetyLimits(vector))
        )
        if not allowed:
            self.state()  # A controller that stopped also says no.
        return allowed

    def start_move(self, target: Pose, *, speed: float, acceleration: float) -> None:
        """Start a straight tool move [m/s, m/s^2] and return at once.

        Raises:
            SafetyError: Beyond the speed or acceleration cap, or not a number.
            DeviceError: The controller refused.
        """
        if not all(map(math.isfinite, target.as_vector())):
            raise SafetyError(f"{self._device}: target {target.as_vector()} is not a pose")
        self._require_slow(speed=speed, acceleration=acceleration)
        link = self._require_link()
        # Two of the controller's threads that drive the arm at once would end its program.
        self.stop()
        self._arm_watchdog(link)
        self._line = LineMove(link)
        self._line.start(target.as_vector(), speed=speed, acceleration=acceleration)

    def is_moving(self) -> bool:
        """Return True until the move started last has ended; see ``Arm``."""
        if self._line is not None:
            self._require_link()
            if not self._line.is_running():
                self._line = None
        return self._line is not None or self._velocity is not None

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Set the tool velocity [m/s, rad/s]; holds until changed, stopped or the watchdog bites.

        Raises:
            SafetyError: Beyond a cap, or not a number.
            DeviceError: The controller refused.
        """
        speed, turn_speed = math.hypot(*velocity[:3]), math.hypot(*velocity[3:])
        self._require_slow(speed=speed, turn_speed=turn_speed, acceleration=acceleration)
        link = self._require_link()
        if self._line is not None:
            self.stop()
        self._arm_watchdog(link)
        self._velocity = (velocity, acceleration)
        self._send_velocity(link, velocity, acceleration)

    def kick_watchdog(self) -> None:
        """Tell the controller that this program lives; call it at ``robot.watchdog`` or faster.

        Raises:
            DeviceError: The arm is lost, so feeding it would only keep it moving.
        """
        link = self._require_link()
        if self._velocity is not None:
            # A kick clears the command register: sent before the controller's next cycle it
            # would swallow a new velocity. Repeating the velocity feeds the watchdog as well.
            self._send_velocity(link, *self._velocity)
        else:
            link.command("feeding the watchdog", lambda c: c.kickWatchdog(), deadline_s=_FEED_S)

    def stop(self) -> None:
        """End any motion. Never raises; returns within 0.2 s.

        When the controller does not answer, the arm counts as lost and is fed no more, so that
        its watchdog stops it.
        """
        try:
            if self._link is not None and self._velocity is not None:
                if not self._link.call(
                    "stopping", lambda c: c.speedStop(_STOP_DECELERATION_M_S2), deadline_s=_STOP_S
                ):
                    raise self._link.health.lose(
                        "did not take the stop", "see why its program ended"
                    )
            elif self._line is not None:
                self._line.stop(_STOP_DECELERATION_M_S2, deadline_s=_STOP_S)
        except DeviceError as error:
            _logger.error("%s", error)
        self._line = self._velocity = None

    def protective_stop(self) -> None:
        """Trigger the controller's protective stop; see ``Arm``."""
        link = self._link
        if link is None:
            raise DeviceError(f"{self._device}: not connected", remedy="call connect first")
        self._line = self._velocity = None
        # The program dies of it, so whether it answers says nothing: the safety bits do.
        activity = "triggering a protective stop"
        link.call(activity, lambda c: c.triggerProtectiveStop())
        end_s = time.monotonic() + _STOP_S
        while safety_reason(link.sample().safety_bits) is None:
            if time.monotonic() > end_s:
                raise link.health.lose(
                    "did not take the protective stop", "press the emergency stop"
                )
            time.sleep(_POLL_S)

    def close(self) -> None:
        """Stop, end the program on the controller and disconnect. Safe to call twice."""
        if self._link is not None:
            self.stop()
            self._link.close()
            self._link = None

    def _require_slow(self, *, speed: float, turn_speed: float = 0.0, acceleration: float) -> None:
        """Refuse a motion beyond a cap, negative, or not a number."""
        for name, asked, limit, unit in (
            ("speed", speed * 1e3, self._speed_cap_m_s * 1e3, "mm/s"),
            ("turning speed", turn_speed, _TURN_SPEED_CAP_RAD_S, "rad/s"),
            ("acceleration", acceleration * 1e3, self._robot.acceleration * 1e3, "mm/s^2"),
        ):
            # Written so that a NaN is refused too.
            if not 0.0 <= asked <= limit * _CAP_ROUNDING:
                raise SafetyError(
                    f"{self._device}: {name} {asked:g} {unit} is beyond the limit of "
                    f"{limit:g} {unit}",
                    remedy="lower it, or raise the robot's limit in the configuration",
                )

    def _send_velocity(self, link: UrLink, velocity: Vector6, acceleration: float) -> None:
        link.command(
            "setting the velocity",
            lambda c: c.speedL(list(velocity), acceleration, 0.0),
            deadline_s=_FEED_S,
        )

    def _arm_watchdog(self, link: UrLink) -> None:
        if not self._watchdog_armed:
            link.command("setting the watchdog", lambda c: c.setWatchdog(self._robot.watchdog))
            self._watchdog_armed = True

    def _require_link(self) -> UrLink:
        if self._link is None:
            raise DeviceError(f"{self._device}: not connected", remedy="call connect first")
        self._link.health.require_alive()
        return self._link
