"""The arm's own estimate of the pressing force, tared in front of the gel: coarse, but another's.

It is compared as a mean over ``WINDOW_S``, and only as a difference from what it said before the
search began, in the same posture.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from tacauchy_rig.core.config.model import RobotModel
from tacauchy_rig.core.run import FZ, ArmSample

WINDOW_S = 0.2
WORST_SHARE, WORST_N = 1.5, 0.5
"""Of the target [1], and more [N]: what a gel may feel at most when the force sensor lies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How far the tared estimate may be from the force.

    Attributes:
        force_n: Whatever the force [N].
        share: And of the force [1].
    """

    force_n: float
    share: float

    def of(self, force_n: float) -> float:
        """Return the tolerance at a force [N]."""
        return self.force_n + self.share * abs(force_n)

    def bounds(self, target_n: float) -> bool:
        """Return whether such an arm finds any lie before the gel feels the worst it may.

        There the force sensor still says less than the target [N], or the press would have ended.
        """
        worst_n = WORST_SHARE * target_n + WORST_N
        return worst_n - target_n >= self.of(worst_n)


TOLERANCE = {
    # Noise of 0.3 N with 10 ms of memory is 0.095 N in the mean of 0.2 s: five deviations. The rest
    # is drift, 0.1 N in 50 s. Its gain: five deviations of 2 %.
    RobotModel.E_SERIES: Tolerance(force_n=0.6, share=0.1),
    # Joint friction that turns round, 2.5 N either way; five deviations of noise, 0.36 N; drift.
    RobotModel.CB3: Tolerance(force_n=7.5, share=0.25),
}
"""None of it was measured on an arm of ours: see docs/explanation/witness.md."""


class ArmEstimate:
    """Mean of the newest estimates, from a zero of its own.

    Args:
        model: Generation of the arm.
        sign: 1 where the controller counts a push on its tool as positive, -1 where as negative.
    """

    def __init__(self, model: RobotModel, *, sign: int = 1) -> None:
        self.tolerance = TOLERANCE[model]
        self._sign = sign
        self._stamps_ns: deque[int] = deque()
        self._forces_n: deque[float] = deque()
        self._zero_n: float | None = None

    def take(self, states: Iterable[ArmSample]) -> None:
        """Take new states; those without an estimate say nothing."""
        for state in states:
            if state.tcp_force is not None:
                self._stamps_ns.append(state.stamp_ns)
                self._forces_n.append(self._sign * state.tcp_force[FZ])
        stamps_ns = self._stamps_ns
        while stamps_ns and stamps_ns[-1] - stamps_ns[0] > WINDOW_S * 1e9:
            stamps_ns.popleft()
            self._forces_n.popleft()

    def zero(self) -> None:
        """Make what is felt now the zero: nothing touches."""
        self._zero_n = self._mean()

    @property
    def has_estimate(self) -> bool:
        """True once the arm has told one."""
        return bool(self._forces_n)

    @property
    def force_n(self) -> float | None:
        """Pressing force as the arm feels it [N]; None without an estimate or a zero."""
        mean_n = self._mean()
        return None if mean_n is None or self._zero_n is None else mean_n - self._zero_n

    def _mean(self) -> float | None:
        return sum(self._forces_n) / len(self._forces_n) if self._forces_n else None
