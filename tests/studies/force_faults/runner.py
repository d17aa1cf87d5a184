"""Press a world in simulated time: the protocol's own servo, guard and judgement, no devices.

A step is one sample of the force sensor, 10 ms. What the protocol does far from the gel is left out
but for the time that it takes. ``test_runner`` compares it with the whole protocol on mock devices.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from drivers.emulators.arm.body import ForceEstimate
from protocols.guard.breach import BreachError, Reaction
from protocols.guard.witness import Witness
from protocols.steps.press import ForceServo
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.model import RigConfig, RobotModel
from tacauchy_rig.core.force_check import ForceCheck, judge_weight, parse_weight
from tacauchy_rig.core.force_history import FORCE_LIMITS, ForceHistory, judge_forces
from tacauchy_rig.core.run import ArmSample, Outcome, Pose, Tare, TrialRecord
from tests.studies.force_faults.worlds import (
    EXPECTED,
    GAIN_PER_K,
    MODULUS_PER_K,
    TRIALS,
    ZERO_N_PER_K,
    Fault,
    Kind,
    MiniGel,
    World,
)

STEP_S = 0.01
LOOK_STEPS = 3
"""The guard looks every 30 ms: later than the real one, and in a third of the time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressed:
    """How a run of a world ended."""

    records: tuple[TrialRecord, ...]  # the attempts that count, in order
    true_n: tuple[float, ...]  # mean true force in the dwell of each of them
    most_n: float  # largest true force in each trial, less what it may be [N]
    history: ForceHistory  # what was found of the sensor over the run
    reason: str  # why it ended early or was not believed; empty where neither is so
    is_doubted: bool  # the force sensor was found faulty, so that no trial is safe

    @property
    def passed(self) -> tuple[int, ...]:
        """Positions of trials that are called safe at the end."""
        return () if self.is_doubted else tuple(range(len(self.records)))

    def beyond(self) -> float:
        """Return by how much of itself a true force is off beyond its stated uncertainty [1].

        Of the trials that passed, the worst.
        """
        worst = -1.0
        for place in self.passed:
            stated = self.history.trials[place].uncertainty
            measured_n = self.records[place].force_measured_n or math.nan
            worst = max(worst, abs(self.true_n[place] / measured_n - 1.0) - stated)
        return worst


class _Failing:
    """What a device with a fault makes of a force [N]."""

    def __init__(self, fault: Fault | None) -> None:
        self._fault = fault
        self._lost = 0.0
        self._lag_n = 0.0
        self._before_n = 0.0

    def reading(self, true_n: float, progress: float) -> float:
        """Return what it makes of the true force ``STEP_S`` after the last."""
        fault = self._fault
        if fault is None:
            return true_n
        since = progress - (fault.trial - 1.0 + fault.moment)
        if since < 0.0:
            self._before_n = true_n
            return true_n
        whole = max(TRIALS - (fault.trial - 1.0 + fault.moment), 0.5)
        grown = min(since / whole, 1.0)
        match fault.kind:
            case Kind.STEP | Kind.CROSS_TALK:
                return true_n * (1.0 - fault.size)
            case Kind.ZERO_STEP:
                return true_n - fault.size
            case Kind.RAMP:
                return true_n * (1.0 - fault.size * grown)
            case Kind.ZERO_RAMP:
                return true_n - fault.size * grown
            case Kind.CREEP:
                aim = fault.size if abs(true_n) > 0.05 else 0.0
                self._lost += (aim - self._lost) * -math.expm1(-STEP_S / fault.time_s)
                return true_n * (1.0 - self._lost)
            case Kind.HYSTERESIS:
                change_n, self._before_n = true_n - self._before_n, true_n
                most_n = math.copysign(2.0 * fault.size, change_n)
                share = -math.expm1(-abs(change_n) / 1.0)
                self._lag_n += (most_n - self._lag_n) * share
                return true_n - self._lag_n

    def sideways(self, true_n: float, progress: float) -> float:
        """Return what it makes of it across its axis [N]."""
        fault = self._fault
        if fault is None or fault.kind is not Kind.CROSS_TALK:
            return 0.0
        return fault.size * true_n if progress >= fault.trial - 1.0 + fault.moment else 0.0


@cache
def config_of(model: RobotModel) -> RigConfig:
    """Return the configuration that is pressed with."""
    return load_config(overrides=[f'robot.model="{model.value}"']).config


class Runner:
    """Presses all trials of a world."""

    def __init__(self, world: World, config: RigConfig) -> None:
        self._world, self._config = world, config
        self._random = random.Random(f"noise {world.seed}")  # noqa: S311 - noise
        self._gel = MiniGel(
            tilt_share=world.tilt_share,
            relaxed_fraction=world.relaxed_fraction,
            relaxation_time_s=world.relaxation_time_s,
        )
        self._cell, self._arm = _Failing(world.sensor), _Failing(world.arm)
        self._estimate = ForceEstimate(world.model, seed=world.seed)
        self._witness = Witness(config, EXPECTED)
        self._time_s = 0.0
        self._z_m = 0.0  # 0 is the gel's surface
        self._speed_m_s = 0.0
        self._commands: deque[float] = deque([0.0] * max(1, round(world.motion_delay_s / STEP_S)))
        self._true_n = self._reading_n = self._zero_n = 0.0
        self._progress = 0.0
        self._trial = 0
        self._pending: list[ArmSample] = []
        self._readings: list[float] = []
        self.most_n = -math.inf

    def run(self) -> Pressed:
        """Press every trial and judge."""
        records: list[TrialRecord] = []
        true_n: list[float] = []
        history, reason, is_doubted = ForceHistory(trials=(), sources=()), "", False
        for index, target_n in enumerate(self._config.protocol.force_targets, start=1):
            self._trial = index
            for attempt in range(1, self._config.protocol.attempts + 1):
                self._progress = index - 1.0 + 0.4 * (attempt - 1)
                try:
                    record, mean_n = self._press(index, target_n)
                except BreachError as breach:
                    self._overrun()
                    reason, is_doubted = breach.message, breach.limit in FORCE_LIMITS
                    break
                if record.passed:
                    break
            if reason:
                break
            records.append(record)
            true_n.append(mean_n)
            history = judge_forces([r for r in records if r.passed], self._world.model)
            if history.fault:
                reason, is_doubted = history.fault, True
                break
        good = [r for r in records if r.passed]
        if not reason and self._world.weighed and good:
            check = self._weigh()
            history = judge_forces(good, self._world.model, weighed=check)
            reason = history.fault if check.passed else f"weight: {check.finding}"
            is_doubted = bool(reason)
        kept = [k for k, r in enumerate(records) if r.passed]
        return Pressed(
            records=tuple(records[k] for k in kept),
            true_n=tuple(true_n[k] for k in kept),
            most_n=self.most_n,
            history=history,
            reason=reason,
            is_doubted=is_doubted,
        )

    def _press(self, index: int, target_n: float) -> tuple[TrialRecord, float]:
        config, protocol = self._config, self._config.protocol
        self._witness.rest()
        self._gel.factor = self._world.stiffness * (1.0 + MODULUS_PER_K * self._warming_k)
        before = self._tare()
        self._zero_n = before
        self._fly(6.0, 0.002)
        for _ in range(30):
            self._step()
        self._witness.begin_search()
        contact_m = self._search()
        self._progress = max(self._progress, index - 1.0 + 0.3)
        self._witness.begin_press(contact_m)
        deepest_m = min(config.limits.max_depth, self._witness.depth_bound(target_n))
        servo = ForceServo(
            target_n=target_n,
            speed_cap=config.robot.press_speed,
            period_s=STEP_S,
            contact_force_n=protocol.contact_force,
        )

        def drive() -> None:
            depth_m = contact_m - self._reported_m
            self._command(servo.update(self._reading_n, depth_m=depth_m))
            self._step()
            self._guard(index, deepest_m, contact_m - self._reported_m)

        first_s = self._time_s
        drive()
        while abs(target_n - servo.filtered_n) > protocol.force_tolerance:
            drive()
            if self._time_s - first_s > protocol.press_timeout:
                raise _breach("protocol.press_timeout", f"{servo.filtered_n:.3f} N")
        self._look()
        curve = self._witness.path()
        settled = self._settle(drive, target_n)
        self._progress = index - 1.0 + 0.6
        forces, trues, depths, arms = [], [], [], []
        for _ in range(round(protocol.dwell_duration / STEP_S)):
            drive()
            forces.append(self._reading_n)
            trues.append(self._true_n)
            depths.append(contact_m - self._reported_m)
            arms.append(self._witness.arm_force_n or 0.0)
        self._progress = index - 1.0 + 0.8
        depth_m, mean_n = float(np.mean(depths)), float(np.mean(forces))
        record = TrialRecord(
            index=index,
            attempt=1,
            outcome=Outcome.PASSED,
            force_target_n=target_n,
            force_measured_n=mean_n,
            depth_measured_m=depth_m,
            arm_force_n=float(np.mean(arms)),
            force_expected_n=self._witness.force_bounds(depth_m),
            press_depth_m=tuple(point[0] for point in curve),
            press_force_n=tuple(point[1] for point in curve),
        )
        self._witness.remember_press()
        self._leave()
        drift_n = self._tare() - before
        self._progress = index - 0.001
        slope = abs(np.polyfit(STEP_S * np.arange(len(forces)), forces, 1)[0])
        missed = (
            not settled
            or abs(mean_n - target_n) > protocol.force_tolerance
            or slope > protocol.dwell_force_rate
            or abs(drift_n) > protocol.drift
        )
        return replace(record, outcome=Outcome.FAILED if missed else Outcome.PASSED), float(
            np.mean(trues)
        )

    def _settle(self, drive: Callable[[], None], target_n: float) -> bool:
        protocol = self._config.protocol
        recent: deque[float] = deque(maxlen=50)
        stamps = STEP_S * np.arange(50)
        for _ in range(round(protocol.settle_timeout / STEP_S)):
            drive()
            recent.append(self._reading_n)
            if len(recent) < 50 or abs(np.mean(recent) - target_n) > protocol.force_tolerance / 2:
                continue
            if abs(np.polyfit(stamps, recent, 1)[0]) <= protocol.dwell_force_rate:
                return True
        return False

    def _search(self) -> float:
        """Go down slowly from just above the gel; return the reported height of contact."""
        config = self._config
        recent: deque[float] = deque(maxlen=3)
        self._z_m = 20e-6
        self._command(config.robot.search_speed / 5.0)
        floor_m = -0.6e-3
        while len(recent) < 3 or sum(recent) / 3.0 < config.protocol.contact_force:
            self._step()
            recent.append(self._reading_n)
            if self._z_m < floor_m:
                raise _breach("witness.contact_height", "nothing was touched")
            if self._sideways_n > config.limits.early_contact:
                raise _breach("witness.sideways", "sideways")
        return self._reported_m

    @property
    def _warming_k(self) -> float:
        return self._world.warming_k * self._progress / TRIALS

    @property
    def _reported_m(self) -> float:
        return self._z_m * (1.0 + self._world.depth_share[self._trial - 1])

    def _command(self, speed_m_s: float) -> None:
        """Set the speed towards the gel."""
        self._speed_m_s = speed_m_s

    def _feel(self) -> None:
        world = self._world
        true_n = self._true_n
        raw_n = self._cell.reading(
            true_n * (world.gain + GAIN_PER_K * self._warming_k), self._progress
        )
        raw_n += world.drift_n_s * self._time_s + ZERO_N_PER_K * self._warming_k
        raw_n += self._random.gauss(0.0, world.noise_n)
        self._sideways_n = self._cell.sideways(true_n, self._progress)
        self._raw_n, self._reading_n = raw_n, raw_n - self._zero_n

    def _step(self) -> None:
        self._commands.append(self._speed_m_s)
        speed_m_s = self._commands.popleft()
        self._z_m -= speed_m_s * STEP_S
        self._time_s += STEP_S
        self._true_n = self._gel.press(-self._z_m, duration_s=STEP_S)
        self._feel()
        felt_n = self._arm.reading(self._true_n, self._progress)
        velocity = (0.0, 0.0, -speed_m_s, 0.0, 0.0, 0.0)
        wrench = (0.0, 0.0, felt_n, 0.0, 0.0, 0.0)
        self._pending.append(
            ArmSample(
                stamp_ns=round(self._time_s * 1e9),
                controller_time_s=self._time_s,
                pose=Pose(position=(0.0, 0.0, self._reported_m), rotation_vector=(0.0, 0.0, 0.0)),
                velocity=velocity,
                runtime_state=2,
                safety_bits=1,
                robot_mode=7,
                tcp_force=self._estimate.advance(wrench, velocity, duration_s=STEP_S),
            )
        )
        self._readings.append(self._reading_n)
        if len(self._readings) == LOOK_STEPS:
            self._look()

    def _look(self) -> None:
        self._witness.check(self._readings, self._pending, z_m=self._reported_m, seen=False)
        self._readings, self._pending = [], []

    def _guard(self, index: int, deepest_m: float, depth_m: float) -> None:
        limits, target_n = self._config.limits, self._config.protocol.force_targets[index - 1]
        self.most_n = max(self.most_n, self._true_n - 1.5 * target_n - 0.5)
        if depth_m > deepest_m:
            raise _breach("witness.depth", f"{depth_m * 1e3:.3f} mm deep")
        if self._reading_n > limits.soft_force:
            raise _breach("limits.soft_force", "soft force")
        if self._sideways_n > limits.lateral_force:
            raise _breach("limits.lateral_force", "sideways")

    def _overrun(self) -> None:
        """Go on for what it takes to stop, unguarded."""
        target_n = self._config.protocol.force_targets[self._trial - 1]
        for _ in range(len(self._commands)):
            self._z_m -= self._commands.popleft() * STEP_S
            self._commands.append(0.0)
            self._true_n = self._gel.press(-self._z_m, duration_s=STEP_S)
            self.most_n = max(self.most_n, self._true_n - 1.5 * target_n - 0.5)

    def _tare(self) -> float:
        """Return the mean raw force of an unloaded second."""
        self._true_n, total_n = 0.0, 0.0
        for _ in range(100):
            self._time_s += STEP_S
            self._feel()
            total_n += self._raw_n
        return total_n / 100.0

    def _fly(self, duration_s: float, z_m: float) -> None:
        """Let time pass off the gel, at the end of a move downwards."""
        self._z_m, self._speed_m_s = z_m, 0.0
        self._commands = deque([0.0] * len(self._commands))
        self._time_s += duration_s
        self._gel.press(0.0, duration_s=duration_s)
        wrench = (0.0,) * 6
        self._estimate.advance(wrench, (0.0, 0.0, -0.01, 0.0, 0.0, 0.0), duration_s=duration_s)

    def _leave(self) -> None:
        self._witness.rest()
        self._unload()
        self._z_m, self._speed_m_s, self._true_n = 0.05, 0.0, 0.0
        self._commands = deque([0.0] * len(self._commands))
        self._time_s += 4.0
        self._gel.press(0.0, duration_s=4.0)
        self._estimate.advance((0.0,) * 6, (0.0, 0.0, 0.01, 0.0, 0.0, 0.0), duration_s=4.0)

    def _unload(self) -> None:
        """Let the devices feel the force go within half a second, and then nothing for four."""
        start_n = self._true_n
        for share in (*np.linspace(1.0, 0.0, 50), *np.zeros(400)):
            self._cell.reading(start_n * float(share), self._progress)

    def _weigh(self) -> ForceCheck:
        weight = parse_weight("200g")
        self._progress = TRIALS + 0.0
        tares = []
        for load_n in (0.0, -weight.force_n, 0.0):
            self._true_n = load_n
            samples = []
            for step in range(300):
                self._time_s += STEP_S
                self._feel()
                if step >= 100:
                    samples.append(self._raw_n)
            tares.append(
                Tare(
                    start_ns=0,
                    end_ns=1,
                    mean=(self._sideways_n, 0.0, float(np.mean(samples)), 0.0, 0.0, 0.0),
                    deviation=(0.0, 0.0, float(np.std(samples)), 0.0, 0.0, 0.0),
                    sample_count=200,
                )
            )
        before, loaded, after = tares
        return judge_weight(
            weight, before=before, loaded=loaded, after=after, compression_sign=1, checked=""
        )


def _breach(limit: str, told: str) -> BreachError:
    return BreachError(f"{limit}: {told}", limit=limit, reaction=Reaction.RETRACT, remedy="")
