"""Streams that went stale, lossy or silent; judged by age, never by waiting."""

from collections import deque

from drivers.interfaces import StreamHealth
from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import ForceSample

RATIO_WINDOW_NS = 2_000_000_000
RATIO_MIN_SAMPLES = 50
DISTURBED_S = 0.015
"""A turn longer than this means that the computer itself was held up: three times its period."""
PATIENCE = 4.0
CLOCK_SLACK = 0.01
"""How far the box's rate may differ from its nominal one."""


class StreamGuard:
    """Ages of force and image, and the share of force frames that did not get through.

    A computer that was held up finds old samples although the sensor is well. So an age counts
    only once the loop has been running undisturbed for as long as the limit; but never is more
    than ``PATIENCE`` times the limit accepted.
    """

    def __init__(self, config: RigConfig) -> None:
        self._limits = config.limits
        self._counts: deque[tuple[int, int, int]] = deque()
        self._undisturbed_s = 0.0
        self._held_up_s = 0.0
        self._period_ns = 1e9 / config.force_sensor.rate
        self._earliest: tuple[int, float] | None = None
        # How late the newest force sample arrived, against the undelayed stream [s].
        self.force_lag_s = 0.0

    def note_turn(self, turn_s: float) -> None:
        """Take how long the loop's last turn was [s]; once a turn, before the checks."""
        if turn_s > DISTURBED_S:
            self._undisturbed_s = 0.0
            self._held_up_s = turn_s
        else:
            self._undisturbed_s += turn_s

    @property
    def held_up_s(self) -> float:
        """How long the computer was held up within the last second [s]; 0 where it was not."""
        return 0.0 if self._undisturbed_s > 1.0 else self._held_up_s

    def note_force(self, sample: ForceSample) -> None:
        """Take the newest force sample: how much later than its number says did it arrive?

        The lower envelope of arrival minus number times period is the undelayed stream. It is
        let rise by ``CLOCK_SLACK``, so that a box whose rate is a little off is not called late.
        """
        offset_ns = sample.stamp_ns - sample.counter * self._period_ns
        if self._earliest is None:
            self._earliest = (sample.stamp_ns, offset_ns)
        since_ns, earliest_ns = self._earliest
        slack_ns = CLOCK_SLACK * (sample.stamp_ns - since_ns)
        self._earliest = (sample.stamp_ns, min(earliest_ns + slack_ns, offset_ns))
        self.force_lag_s = (offset_ns - self._earliest[1]) * 1e-9

    def check_force(self, health: StreamHealth, *, now_ns: int) -> None:
        """Refuse a force stream that is stale, late or lossy."""
        lag_s, age_s = self.force_lag_s, health.age_s
        finding = "force samples arrive {:.0f} ms late"
        remedy = "see `tacauchy-rig doctor`: latency timer of the serial adapter"
        self._require_fresh("force", lag_s, finding, Reaction.HOLD, remedy)
        finding = "the newest force sample is {:.0f} ms old"
        remedy = "check the box's power and cable, then `tacauchy-rig doctor`"
        self._require_fresh("force", age_s, finding, Reaction.HOLD, remedy)
        self._check_losses(health, now_ns)

    def check_image(self, health: StreamHealth) -> None:
        """Refuse a camera whose images are stale, or the same again and again."""
        finding = "the newest image is {:.0f} ms old"
        remedy = "check the camera's cable and USB port, then `tacauchy-rig doctor`"
        self._require_fresh("image", health.age_s, finding, Reaction.RETRACT, remedy)
        if health.repeat_count >= self._limits.repeat_count:
            raise BreachError(
                f"limits.repeat_count: {health.repeat_count} identical images in a row; a live "
                "camera has noise",
                limit="limits.repeat_count",
                reaction=Reaction.RETRACT,
                remedy="unplug the camera and plug it in again, then `tacauchy-rig doctor`",
            )

    def _require_fresh(
        self, stream: str, age_s: float, finding: str, reaction: Reaction, remedy: str
    ) -> None:
        name = f"limits.stale_{stream}"
        limit_s: float = getattr(self._limits, f"stale_{stream}")
        apart_s = abs(age_s)  # a sample from the future was stamped by another clock
        disturbed = self._undisturbed_s < limit_s and apart_s <= PATIENCE * limit_s
        if apart_s > limit_s and not disturbed:
            text = f"{name} {limit_s * 1e3:g} ms: {finding.format(age_s * 1e3)}"
            if self.held_up_s > 0.0:
                text += f" (this computer was held up for {self.held_up_s * 1e3:.0f} ms, "
                text += f"{self._undisturbed_s * 1e3:.0f} ms ago)"
            raise BreachError(text, limit=name, reaction=reaction, remedy=remedy)

    def _check_losses(self, health: StreamHealth, now_ns: int) -> None:
        bad = max(health.lost_count, health.corrupt_count)
        self._counts.append((now_ns, health.received_count, bad))
        while now_ns - self._counts[0][0] > RATIO_WINDOW_NS:
            self._counts.popleft()
        received = health.received_count - self._counts[0][1]
        lost = bad - self._counts[0][2]
        total = received + lost
        if total >= RATIO_MIN_SAMPLES and lost > self._limits.corrupt_ratio * total:
            raise BreachError(
                f"limits.corrupt_ratio {self._limits.corrupt_ratio:.0%}: {lost} of {total} force "
                f"frames in the last {RATIO_WINDOW_NS // 10**9} s were lost or damaged",
                limit="limits.corrupt_ratio",
                reaction=Reaction.RETRACT,
                remedy="check the cable's length and shield; a lower baud rate loses fewer",
            )
