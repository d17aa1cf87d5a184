"""Press to the target force by a servo in velocity, settle, and hold.

The arm is an integrator, the gel a spring of unknown stiffness:
speed = (K e + I) / k with e the force error [N], K the bandwidth [1/s], I the integral that
follows the gel's relaxation [N/s] and k the secant stiffness seen so far [N/m]. With about 0.1 s
of delay in the loop K = 2.5/s leaves a factor of four before it oscillates.
"""

import math
from collections import deque
from dataclasses import replace

from protocols.control.cycle import Cycle, Press, Reading, turns
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.force_limits import Contact
from protocols.guard.place_and_motion import DepthGuard
from protocols.steps.arm_moves import downward
from protocols.steps.tare_and_force_window import summarise
from tacauchy_rig.core.run import TrialRecord

BANDWIDTH_PER_S = 2.5
INTEGRAL_PER_S2 = 0.8
INTEGRAL_BAND_N = 0.05
INTEGRAL_LIMIT_N_S = 0.4
FILTER_TIME_S = 0.03
STIFFNESS_MIN_N_M = 300.0
STIFFNESS_MAX_N_M = 20e3
STIFFNESS_DEPTH_M = 30e-6


class ForceServo:
    """Turns force samples into a speed towards the gel; ``contact_force_n`` is at depth zero."""

    def __init__(
        self, *, target_n: float, speed_cap: float, period_s: float, contact_force_n: float
    ) -> None:
        self.target_n = target_n
        self.filtered_n = contact_force_n
        self._speed_cap = speed_cap
        self._period_s = period_s
        self._contact_force_n = contact_force_n
        self._smoothing = period_s / (FILTER_TIME_S + period_s)
        self._integral_n_s = 0.0
        self._stiffness_n_m = STIFFNESS_MAX_N_M

    def update(self, force_n: float, *, depth_m: float) -> float:
        """Take one sample at ``depth_m`` below contact; return the speed towards the gel [m/s]."""
        self.filtered_n += self._smoothing * (force_n - self.filtered_n)
        if depth_m >= STIFFNESS_DEPTH_M:
            secant = (self.filtered_n - self._contact_force_n) / depth_m
            self._stiffness_n_m = min(STIFFNESS_MAX_N_M, max(STIFFNESS_MIN_N_M, secant))
        error_n = self.target_n - self.filtered_n
        if abs(error_n) < INTEGRAL_BAND_N:
            step = INTEGRAL_PER_S2 * error_n * self._period_s
            total = self._integral_n_s + step
            self._integral_n_s = min(INTEGRAL_LIMIT_N_S, max(-INTEGRAL_LIMIT_N_S, total))
        speed = (BANDWIDTH_PER_S * error_n + self._integral_n_s) / self._stiffness_n_m
        return min(self._speed_cap, max(-self._speed_cap, speed))


SETTLE_WINDOW_S = 0.5


class PressDrive:
    """Moves the indenter by the servo, one turn at a time; depth counts from ``contact_z_m``."""

    def __init__(self, cycle: Cycle, *, target_n: float, contact_z_m: float) -> None:
        self._cycle = cycle
        self._contact_z_m = contact_z_m
        self.target_n = target_n
        self._servo = ForceServo(
            target_n=target_n,
            speed_cap=cycle.config.robot.press_speed,
            period_s=1.0 / cycle.config.force_sensor.rate,
            contact_force_n=cycle.config.protocol.contact_force,
        )
        cycle.force_guard.contact = Contact.EXPECTED
        cycle.witness.begin_press(contact_z_m)
        self._guard = DepthGuard(
            cycle.config, target_n=target_n, needed_m=cycle.witness.depth_bound(target_n)
        )

    @property
    def error_n(self) -> float:
        """Target minus low-passed force [N]."""
        return self.target_n - self._servo.filtered_n

    def depth(self, reading: Reading) -> float:
        """Return the depth below contact [m]."""
        return self._contact_z_m - reading.arm.pose.position[2]

    def turn(self) -> Reading:
        """Do one turn of the control loop and steer by what it brought."""
        reading = self.watch()
        depth_m = self.depth(reading)
        if reading.presses:
            speeds = [self._servo.update(p.force_n, depth_m=depth_m) for p in reading.presses]
            self._cycle.set_velocity(downward(speeds[-1]))
        return reading

    def watch(self) -> Reading:
        """Do one turn of the control loop without steering."""
        reading = self._cycle.turn()
        self._guard.check(self.depth(reading), force_n=self._cycle.last_force_n)
        return reading


def press_to_target(cycle: Cycle, drive: PressDrive) -> None:
    """Press until the force is within tolerance of the target."""
    protocol = cycle.config.protocol
    for _ in turns(drive.turn, protocol.press_timeout):
        if abs(drive.error_n) <= protocol.force_tolerance:
            return
    raise BreachError(
        f"protocol.press_timeout {protocol.press_timeout:g} s: the force is still "
        f"{abs(drive.error_n):.3f} N from the target",
        limit="protocol.press_timeout",
        reaction=Reaction.RETRACT,
        remedy="raise press_timeout or robot.press_speed",
    )


def settle(cycle: Cycle, drive: PressDrive) -> bool:
    """Hold until mean and slope of half a second are inside their gates.

    Returns:
        False when ``protocol.settle_timeout`` passed first; the verdict will say so.
    """
    protocol = cycle.config.protocol
    needed = round(SETTLE_WINDOW_S * cycle.config.force_sensor.rate)
    recent: deque[Press] = deque(maxlen=needed)
    for reading in turns(drive.turn, protocol.settle_timeout):
        recent.extend(reading.presses)
        if reading.presses and len(recent) == needed:
            window = summarise(tuple(recent))
            is_near = abs(window.mean_n - drive.target_n) <= protocol.force_tolerance / 2
            if is_near and abs(window.slope_n_s) <= protocol.dwell_force_rate:
                return True
    return False


def hold(cycle: Cycle, drive: PressDrive, record: TrialRecord) -> TrialRecord:
    """Hold for ``protocol.dwell_duration``, the window that counts; return what it gave."""
    duration_ns = round(cycle.config.protocol.dwell_duration * 1e9)
    presses: list[Press] = []
    depths: list[float] = []
    arm_n: list[float] = []
    while len(presses) < 2 or presses[-1].stamp_ns - presses[0].stamp_ns < duration_ns:
        reading = drive.turn()
        presses += reading.presses
        depths.append(drive.depth(reading))
        felt_n = cycle.witness.arm_force_n
        arm_n += [] if felt_n is None else [felt_n]
    force, depth_m = summarise(presses), sum(depths) / len(depths)
    return replace(
        record,
        force_measured_n=force.mean_n,
        force_deviation_n=force.deviation_n,
        force_rate_n_s=force.slope_n_s,
        depth_measured_m=depth_m,
        arm_force_n=sum(arm_n) / len(arm_n) if arm_n else None,
        force_expected_n=cycle.witness.force_bounds(depth_m),
        dwell_start_ns=force.start_ns,
        dwell_end_ns=force.end_ns,
    )


FREQUENCIES_HZ = (1.1, 2.9)
"""No multiples of one another; the faster one has 6 frames a period at 18.75 fps."""
SPEED_SHARE = 0.45
"""Of ``robot.press_speed``, each; what is left leads the arm back to the path."""
RETURN_PER_S = 2.0
"""How quickly the arm is led back to its path [1/s]."""


def sway(cycle: Cycle, drive: PressDrive) -> None:
    """Sway for ``protocol.sway`` from where the arm stands; its trace tells how late images are.

    Two sines at once: a delay shifts both by the same time, the gel's relaxation by the same part
    of their period. The arm only goes up from where the force was held, so that neither force nor
    depth passes what the press had reached.
    """
    config = cycle.config
    cap_m_s, start = config.robot.press_speed, drive.watch()
    for reading in turns(drive.watch, config.protocol.sway):
        time_s = (reading.now_ns - start.now_ns) * 1e-9
        depth_m, speed_m_s = drive.depth(start), 0.0
        for frequency_hz in FREQUENCIES_HZ:
            rate = 2.0 * math.pi * frequency_hz
            depth_m -= SPEED_SHARE * cap_m_s / rate * (1.0 - math.cos(rate * time_s))
            speed_m_s -= SPEED_SHARE * cap_m_s * math.sin(rate * time_s)
        led_m_s = speed_m_s + RETURN_PER_S * (depth_m - drive.depth(reading))
        cycle.set_velocity(downward(min(cap_m_s, max(-cap_m_s, led_m_s))))
