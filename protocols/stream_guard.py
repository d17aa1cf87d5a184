"""Streams that went stale, lossy or silent; judged by age, never by waiting."""

from __future__ import annotations

from collections import deque

from drivers.interfaces import StreamHealth
from protocols.breach import BreachError, Reaction
from tacauchy_rig.config.model import RigConfig

RATIO_WINDOW_NS = 2_000_000_000
RATIO_MIN_SAMPLES = 50
DISTURBED_S = 0.015
"""A turn longer than this means that the computer itself was held up: three times its period."""
PATIENCE = 4.0


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

    def note_turn(self, turn_s: float) -> None:
        """Take how long the loop's last turn was [s]; once a turn, before the checks."""
        if turn_s > DISTURBED_S:
            self._undisturbed_s = 0.0
            self._held_up_s = turn_s
        else:
            self._undisturbed_s += turn_s

    def check_force(self, health: StreamHealth, *, now_ns: int) -> None:
        """Judge the force stream.

        Raises:
            BreachError: Stale, or too many frames lost.
        """
        limit = self._limits.stale_force
        if self._is_stale(health.age_s, limit):
            raise BreachError(
                f"limits.stale_force {limit * 1e3:g} ms: the newest force sample is "
                f"{health.age_s * 1e3:.0f} ms old{self._excuse()}",
                limit="limits.stale_force",
                reaction=Reaction.HOLD,
                remedy="check the box's power and cable, then `tacauchy-rig doctor`",
            )
        self._check_losses(health, now_ns)

    def check_image(self, health: StreamHealth) -> None:
        """Judge the camera.

        Raises:
            BreachError: Stale.
        """
        limit = self._limits.stale_image
        if self._is_stale(health.age_s, limit):
            raise BreachError(
                f"limits.stale_image {limit * 1e3:g} ms: the newest image is "
                f"{health.age_s * 1e3:.0f} ms old{self._excuse()}",
                limit="limits.stale_image",
                reaction=Reaction.RETRACT,
                remedy="check the camera's cable and USB port, then `tacauchy-rig doctor`",
            )

    def _is_stale(self, age_s: float, limit_s: float) -> bool:
        if age_s <= limit_s:
            return False
        return self._undisturbed_s >= limit_s or age_s > PATIENCE * limit_s

    def _excuse(self) -> str:
        if self._undisturbed_s > 1.0 or self._held_up_s == 0.0:
            return ""
        return (
            f" (this computer was held up for {self._held_up_s * 1e3:.0f} ms, "
            f"{self._undisturbed_s * 1e3:.0f} ms ago)"
        )

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
