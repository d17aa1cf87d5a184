"""One small world behind the mock devices: an arm that moves, a gel that pushes back.

Nothing runs by itself: each device first asks the world to catch up with the clock, so the same
mocks work with a simulated clock and, across processes, with the host's.
"""

import math
import random
from collections.abc import Callable, Iterable
from functools import partial

from drivers.emulators.faults import Device, Fault, FaultKind, parse_fault
from drivers.interfaces import Clock
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import Pose, Vector6, vector6

STEP_S = 0.002
_STEP_NS = round(STEP_S * 1e9)

Still: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Gel:
    """A gel small enough for tests: a spring beside a spring and damper in series.

    Standard linear solid under a flat punch, F = k (1 - r) d + q, dq/dt = k r dd/dt - q / tau:
    after a step in depth d the force relaxes by the fraction r over some tau seconds.

    Args:
        stiffness_n_m: Instantaneous stiffness k [N/m].
        relaxed_fraction: Fraction r of the force that relaxes.
        relaxation_time_s: Time constant tau [s].
    """

    def __init__(
        self,
        *,
        stiffness_n_m: float = 3500.0,
        relaxed_fraction: float = 0.07,
        relaxation_time_s: float = 2.0,
    ) -> None:
        self.stiffness_n_m = stiffness_n_m
        self.relaxed_fraction = relaxed_fraction
        self.relaxation_time_s = relaxation_time_s
        self._depth_m = 0.0
        self._memory_n = 0.0

    def press(self, depth_m: float, *, duration_s: float) -> float:
        """Move to ``depth_m`` [m] within ``duration_s`` [s]; return the pressing force [N]."""
        depth_m = max(depth_m, 0.0)
        decay = math.exp(-duration_s / self.relaxation_time_s)
        step = self.stiffness_n_m * self.relaxed_fraction * (depth_m - self._depth_m)
        self._memory_n = self._memory_n * decay + step
        self._depth_m = depth_m
        if depth_m == 0.0:
            return 0.0
        return max(0.0, self.stiffness_n_m * (1 - self.relaxed_fraction) * depth_m + self._memory_n)


class MockWorld:
    """State that the mock devices share.

    Args:
        clock: Simulated, or the host's.
        config: Says where home and the gel are, and the force sensor's sign and rate.
        gel: What the indenter presses into.
        noise_n: Standard deviation of the force sensor's noise [N].
        drift_n_s: Drift of its zero [N/s].
        bias: Raw wrench while nothing touches [N, N m].
        surface_offset_m: How much higher the gel lies than the configuration says.
        motion_delay_s: From a velocity command to the arm's reaction.
    """

    def __init__(
        self,
        clock: Clock,
        config: RigConfig,
        *,
        gel: Gel | None = None,
        noise_n: float = 0.008,
        drift_n_s: float = 0.0007,
        bias: Vector6 = (0.3, -0.2, 1.4, 0.001, -0.002, 0.0),
        surface_offset_m: float = 0.0,
        motion_delay_s: float = 0.02,
        seed: int = 1,
    ) -> None:
        self.clock = clock
        self.config = config
        self.gel = gel or Gel()
        self.noise_n = noise_n
        self.drift_n_s = drift_n_s
        self.bias = bias
        self.motion_delay_s = motion_delay_s
        self.random = random.Random(seed)  # noqa: S311 - noise, not a secret
        self.surface_z_m = config.sensor.surface[2] + surface_offset_m
        self.pose = Pose(position=config.robot.home, rotation_vector=config.robot.tool_rotation)
        self.velocity: Vector6 = Still
        self.force_n = 0.0
        self.disturbance: Vector6 = Still  # wrench that something else exerts on the sensor
        self.faults: list[Fault] = []  # those that are on now
        self.on_fault: list[Callable[[Fault, bool], None]] = []
        self.start_ns = clock.now_ns()
        self.now_ns = self.start_ns  # time the world has reached [ns]
        self._drive: Callable[[float], Vector6] | None = None
        self._listeners: list[Callable[[int], None]] = []
        self._plans: list[tuple[Callable[[], bool], Callable[[], None]]] = []

    @property
    def elapsed_s(self) -> float:
        """Time since the world began [s]."""
        return (self.now_ns - self.start_ns) * 1e-9

    def drive(self, velocity_after: Callable[[float], Vector6]) -> None:
        """Let ``velocity_after(step_s)`` give the tool's velocity [m/s, rad/s] at each step."""
        self._drive = velocity_after

    def on_step(self, listener: Callable[[int], None]) -> None:
        """Call ``listener(now_ns)`` after each step; how mock devices make their samples."""
        self._listeners.append(listener)

    def when(self, condition: Callable[[], bool], action: Callable[[], None]) -> None:
        """Do ``action`` once, at the first step at which ``condition`` holds."""
        self._plans.append((condition, action))

    def begin(self, fault: Fault | str) -> None:
        """Let a fault begin; text is parsed as for the emulators."""
        fault = parse_fault(fault) if isinstance(fault, str) else fault
        self.faults.append(fault)
        for listener in self.on_fault:
            listener(fault, True)

    def end(self, fault: Fault | str) -> None:
        """Let a fault end that ``begin`` has begun."""
        fault = parse_fault(fault) if isinstance(fault, str) else fault
        self.faults.remove(fault)
        for listener in self.on_fault:
            listener(fault, False)

    def faults_of(self, device: Device) -> dict[FaultKind, Fault]:
        """Return the faults of ``device`` that are on now."""
        faults = self.faults  # a dozen questions a step, nearly always of none
        return {each.kind: each for each in faults if each.device is device} if faults else {}

    def plan(self, faults: Iterable[str]) -> None:
        """Let faults such as ``robot:protective-stop@3s`` begin and end in time."""
        for fault in map(parse_fault, faults):
            end_s = fault.start_s + fault.duration_s
            self.when(partial(self._is_past, fault.start_s), partial(self.begin, fault))
            if math.isfinite(end_s):
                self.when(partial(self._is_past, end_s), partial(self.end, fault))

    def _is_past(self, time_s: float) -> bool:
        return self.elapsed_s >= time_s

    def catch_up(self) -> None:
        """Integrate up to the clock's time."""
        target_ns = self.clock.now_ns()
        while self.now_ns + _STEP_NS <= target_ns:
            self.now_ns += _STEP_NS
            self._step()

    def raw_wrench(self) -> Vector6:
        """Return what the sensor would report now, with bias, drift and noise [N, N m]."""
        drift = self.drift_n_s * self.elapsed_s
        along = self.config.force_sensor.compression_sign * (self.force_n + drift)
        load: Vector6 = (0.01 * self.force_n, 0.0, along, 0.0, 0.0, 0.0)
        scales = (self.noise_n,) * 3 + (self.noise_n * 1e-2,) * 3
        rows, gauss = zip(self.bias, load, self.disturbance, scales, strict=True), self.random.gauss
        return vector6([b + f + d + gauss(0.0, s) for b, f, d, s in rows])

    def felt_by_arm(self, *, duration_s: float) -> Vector6:
        """Return what an arm feels now that was asked so long ago [N, N m]."""
        del duration_s
        return (0.0, 0.0, self.force_n, 0.0, 0.0, 0.0)

    def reported_pose(self) -> Pose:
        """Return where the arm takes its tip to be."""
        return self.pose

    def _step(self) -> None:
        if self._drive is not None:
            self.velocity = self._drive(STEP_S)
        vx, vy, vz = self.velocity[:3]
        if vx or vy or vz:
            self.pose = self.pose.shifted(x=vx * STEP_S, y=vy * STEP_S, z=vz * STEP_S)
        depth_m = self.surface_z_m - self.pose.position[2]
        self.force_n = self.gel.press(depth_m, duration_s=STEP_S)
        for listener in self._listeners:
            listener(self.now_ns)
        for plan in list(self._plans):
            condition, action = plan
            if condition():
                self._plans.remove(plan)
                action()
