"""How long a run still takes: first by its speeds and ways, later by how long its trials took."""

from collections.abc import Sequence

import numpy as np

from protocols.steps.preflight import TRAVEL_M
from protocols.trials.trial_sequence import PlannedTrial
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import ExpectedPress, JournalEvent, Outcome
from tacauchy_rig.core.store.free_space import trial_duration_s

UNKNOWN_DEPTH_M = 0.5e-3
SETTLE_S = 2.0
"""What slowing down before the target and settling on it add, about."""


class TimeLeft:
    """Follows a run by its events; ``expected`` tells how deep a press goes."""

    def __init__(
        self, config: RigConfig, plan: Sequence[PlannedTrial], expected: ExpectedPress | None
    ) -> None:
        self._planned_s = {
            trial.index: expected_duration_s(config, trial.force_target_n, expected)
            for trial in plan
            if not trial.done
        }
        self._last = {each.index: each.next_attempt + config.protocol.attempts - 1 for each in plan}
        self._before_s = _before_trials_s(config)
        self._begun_ns: int | None = None
        self._trial = 0
        self._taken: list[float] = []
        self._ended = False

    def note(self, event: JournalEvent) -> None:
        """Take in an event."""
        match event.name:
            case "run-start":
                self._begun_ns = event.stamp_ns
            case "attempt-start":
                self._trial, self._begun_ns, self._before_s = event.trial, event.stamp_ns, 0.0
            case "attempt-end" if event.trial in self._planned_s and self._begun_ns is not None:
                took_s = (event.stamp_ns - self._begun_ns) * 1e-9
                self._trial, self._begun_ns = 0, event.stamp_ns
                passed = event.detail.get("outcome") == Outcome.PASSED
                if passed:  # others may have ended early
                    self._taken.append(took_s / self._planned_s[event.trial])
                if passed or event.attempt >= self._last[event.trial]:
                    del self._planned_s[event.trial]
            case "run-end":
                self._ended = True

    def seconds(self, now_ns: int) -> float | None:
        """Return the seconds left; None before the run begins."""
        if self._ended:
            return 0.0
        if self._begun_ns is None:
            return None
        slower = sum(self._taken) / len(self._taken) if self._taken else 1.0
        current_s = self._planned_s.get(self._trial, 0.0) * slower + self._before_s
        later_s = sum(s for trial, s in self._planned_s.items() if trial != self._trial)
        gone_s = (now_ns - self._begun_ns) * 1e-9
        return max(current_s - gone_s, 0.0) + later_s * slower


def expected_duration_s(
    config: RigConfig, target_n: float, expected: ExpectedPress | None
) -> float:
    """Return about how long a trial takes from home to its verdict [s]."""
    depth_m = UNKNOWN_DEPTH_M
    if expected is not None:
        depth_m = float(np.interp(target_n, expected.force_n, expected.depth_m))
    press_s = depth_m / config.robot.press_speed + SETTLE_S
    return trial_duration_s(config, search_m=config.protocol.approach_height, press_s=press_s)


def _before_trials_s(config: RigConfig) -> float:
    robot, protocol = config.robot, config.protocol
    way_m = abs(robot.home[2] - config.sensor.surface[2] - protocol.air_press_height - TRAVEL_M)
    there_and_back_s = way_m / robot.approach_speed + way_m / robot.retract_speed
    return protocol.tare_duration + there_and_back_s + TRAVEL_M / robot.search_speed
