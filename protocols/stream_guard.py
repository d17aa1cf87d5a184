"""Streams that went stale, lossy or silent; judged by age, never by waiting."""

from __future__ import annotations

from collections import deque

from drivers.interfaces import StreamHealth
from protocols.breach import BreachError, Reaction
from tacauchy_rig.config.model import RigConfig

RATIO_WINDOW_NS = 2_000_000_000
RATIO_MIN_SAMPLES = 50


class StreamGuard:
    """Ages of force and image, and the share of force frames that did not get through.

    A loop that was itself held up finds old samples although the sensor is well; so an age counts
    only when the loop has just looked, one undisturbed turn before.
    """

    def __init__(self, config: RigConfig) -> None:
        self._limits = config.limits
        self._counts: deque[tuple[int, int, int]] = deque()

    def check_force(self, health: StreamHealth, *, now_ns: int, turn_s: float) -> None:
        """Judge the force stream; ``turn_s`` [s] is how long ago the loop looked last.

        Raises:
            BreachError: Stale, or too many frames lost.
        """
        limit = self._limits.stale_force
        if health.age_s > limit and turn_s < limit / 2:
            raise BreachError(
                f"limits.stale_force {limit * 1e3:g} ms: the newest force sample is "
                f"{health.age_s * 1e3:.0f} ms old",
                limit="limits.stale_force",
                reaction=Reaction.HOLD,
                remedy="check the box's power and cable, then `tacauchy-rig doctor`",
            )
        self._check_losses(health, now_ns)

    def check_image(self, health: StreamHealth, *, turn_s: float) -> None:
        """Judge the camera.

        Raises:
            BreachError: Stale.
        """
        limit = self._limits.stale_image
        if health.age_s > limit and turn_s < limit / 2:
            raise BreachError(
                f"limits.stale_image {limit * 1e3:g} ms: the newest image is "
                f"{health.age_s * 1e3:.0f} ms old",
                limit="limits.stale_image",
                reaction=Reaction.RETRACT,
                remedy="check the camera's cable and USB port, then `tacauchy-rig doctor`",
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
