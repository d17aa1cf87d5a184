"""Press a drawn world by the whole protocol, on mock devices in simulated time."""

import math
from dataclasses import dataclass

import numpy as np

from drivers.force_sensor.weighing import Load, weigh_connected
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.force_sensor_gain import (
    FORCE_HISTORY,
    FORCE_LIMITS,
    ForceHistory,
    judge_forces,
)
from tacauchy_rig.core.known_weight import ForceCheck, judge_weight, parse_weight
from tacauchy_rig.core.run import JournalEvent, Outcome, Phase, Pose, TrialRecord, Vector6, vector6
from tests.mock.bench import SimulatedClock
from tests.mock.streams import MockForceSensor
from tests.mock.world import MockWorld
from tests.protocols.conftest import NEAR, STRICT, laboratory_of
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

_BEGUN = {Phase.PRESS: 0.3, Phase.DWELL: 0.6, Phase.RETRACT: 0.8, Phase.VERDICT: 0.999}
"""Of a trial, when a phase begins; a fault's moment is told in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressed:
    """How a run of a world ended."""

    records: tuple[TrialRecord, ...]  # the attempts that passed, in order
    true_n: tuple[float, ...]  # mean true force in the dwell of each of them
    most_n: float  # largest true force in any trial, less what it may be [N]
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

    def reading(self, true_n: float, progress: float, *, duration_s: float) -> float:
        """Return what it makes of the true force so long after the last."""
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
                self._lost += (aim - self._lost) * -math.expm1(-duration_s / fault.time_s)
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


class _DrawnWorld(MockWorld):
    """A mock world with the gel, drifts and faults of a drawn one."""

    def __init__(self, drawn: World) -> None:
        known = [f'robot.model="{drawn.model.value}"', f"emulation.seed={drawn.seed}"]
        self._gel = MiniGel(
            tilt_share=drawn.tilt_share,
            relaxed_fraction=drawn.relaxed_fraction,
            relaxation_time_s=drawn.relaxation_time_s,
        )
        super().__init__(
            SimulatedClock(),
            load_config(overrides=[*STRICT, *NEAR, *known]).config,
            gel=self._gel,
            noise_n=drawn.noise_n,
            drift_n_s=drawn.drift_n_s,
            motion_delay_s=drawn.motion_delay_s,
            seed=drawn.seed,
        )
        self._drawn = drawn
        self._cell, self._arm = _Failing(drawn.sensor), _Failing(drawn.arm)
        self.hung_n = 0.0  # pulls at the cell
        self.progress = 0.0  # trials, with the part of the one that is under way
        self.most_n = -math.inf
        self.dwelt_n: dict[int, float] = {}  # mean true force in the last dwell of each trial
        self._held_n: list[float] = []
        self._trial, self._phase = 0, Phase.PREFLIGHT
        self.on_step(self._watch)

    def hear(self, event: JournalEvent) -> None:
        """Go on with the protocol's phases."""
        if event.name != "phase" or not event.trial:
            return
        if self._phase is Phase.DWELL:
            self.dwelt_n[self._trial] = float(np.mean(self._held_n))
        self._trial, self._phase = event.trial, Phase(event.detail["phase"])
        begun = event.trial - 1.0 + _BEGUN.get(self._phase, 0.4 * (event.attempt - 1))
        self.progress = max(self.progress, begun)
        self._held_n = []
        self._gel.factor = self._drawn.stiffness * (1.0 + MODULUS_PER_K * self._warming_k)

    def raw_wrench(self) -> Vector6:
        """Return what the sensor would report now [N, N m]."""
        true_n, warming_k = self.force_n - self.hung_n, self._warming_k
        felt_n = true_n * (self._drawn.gain + GAIN_PER_K * warming_k)
        read_n = self._cell.reading(
            felt_n, self.progress, duration_s=1.0 / self.config.force_sensor.rate
        )
        read_n += self.drift_n_s * self.elapsed_s + ZERO_N_PER_K * warming_k
        along_n = self.config.force_sensor.compression_sign * read_n
        load = (self._cell.sideways(true_n, self.progress), 0.0, along_n, 0.0, 0.0, 0.0)
        scales = (self.noise_n,) * 3 + (self.noise_n * 1e-2,) * 3
        rows = zip(load, scales, strict=True)
        return vector6(value + self.random.gauss(0.0, scale) for value, scale in rows)

    def felt_by_arm(self, *, duration_s: float) -> Vector6:
        """Return what the arm feels, with its fault."""
        felt_n = self._arm.reading(self.force_n, self.progress, duration_s=duration_s)
        return (0.0, 0.0, felt_n, 0.0, 0.0, 0.0)

    def reported_pose(self) -> Pose:
        """Return the pose with a way into the gel that is off by a share."""
        below_m = min(0.0, self.pose.position[2] - self.surface_z_m)
        return self.pose.shifted(z=below_m * self._drawn.depth_share[max(self._trial - 1, 0)])

    @property
    def _warming_k(self) -> float:
        return self._drawn.warming_k * self.progress / TRIALS

    def _watch(self, _now_ns: int) -> None:
        if self._trial:
            target_n = self.config.protocol.force_targets[self._trial - 1]
            self.most_n = max(self.most_n, self.force_n - 1.5 * target_n - 0.5)
        if self._phase is Phase.DWELL:
            self._held_n.append(self.force_n)


def press(drawn: World) -> Pressed:
    """Press every trial of a world and judge."""
    world = _DrawnWorld(drawn)
    laboratory = laboratory_of(world, expected=EXPECTED, listener=world.hear)
    result = laboratory.run()
    good = [record for record in result.records if record.passed]
    missed = {c.name for record in result.records for c in record.criteria if not c.passed}
    missed |= {e.detail["limit"] for e in laboratory.sink.events if e.name == "fault"}
    is_doubted = bool(missed & {*FORCE_LIMITS, FORCE_HISTORY})
    history = judge_forces(good, drawn.model)
    reason = result.reason if result.outcome is Outcome.FAULT else ""
    if drawn.weighed and good and not reason:
        world.progress = float(TRIALS)
        check = _weighed(world, laboratory.bench.force_sensor)
        history = judge_forces(good, drawn.model, weighed=check)
        reason = history.fault if check.passed else f"weight: {check.finding}"
        is_doubted = bool(reason)
    return Pressed(
        records=tuple(good),
        true_n=tuple(world.dwelt_n[record.index] for record in good),
        most_n=world.most_n,
        history=history,
        reason=reason,
        is_doubted=is_doubted,
    )


def _weighed(world: _DrawnWorld, sensor: MockForceSensor) -> ForceCheck:
    weight = parse_weight("200g")

    def hang(load: Load) -> None:
        world.hung_n = weight.force_n if load is Load.WEIGHT else 0.0

    before, loaded, after = weigh_connected(sensor, world.clock, world.config, ask=hang)
    sign = world.config.force_sensor.compression_sign
    return judge_weight(
        weight, before=before, loaded=loaded, after=after, compression_sign=sign, checked=""
    )
