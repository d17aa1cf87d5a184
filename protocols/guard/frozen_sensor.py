"""A force sensor that sticks or repeats itself: its noise is gone, or old samples come again."""

import math
from collections import deque

from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.run import FZ, Vector6

NOISE_SAMPLES = 30
NOISE_SHARE = 0.1
"""Of the noise while nothing touched. By chance 30 samples never fall so low (F-distribution, below
1e-20), and a table that has come to rest since takes a factor of a few."""
MEMORY_SAMPLES = 20_000
"""Samples that are remembered: 200 s at 100 Hz."""


class Liveness:
    """Watches one sensor's samples for noise that has gone, and for rows that come again.

    A live sensor has noise: its deviation cannot fall to a tenth of what it was by chance, and it
    never repeats a row of samples, of so many in a row.
    """

    def __init__(self, *, row: int) -> None:
        self._row = row
        self._newest_n: float | None = None
        self._steps: deque[float] = deque(maxlen=NOISE_SAMPLES - 1)
        self._unloaded_n: float | None = None
        self._number = 0
        self._numbers: dict[Vector6, int] = {}
        self._order: deque[tuple[int, Vector6]] = deque()
        self._before: int | None = None
        self._row_count = 0

    def set_noise(self) -> None:
        """Compare from now on with the noise of the newest samples: nothing touches."""
        self._unloaded_n = self._noise()
        self._newest_n = None
        self._steps.clear()

    def check(self, wrench: Vector6) -> None:
        """Refuse one more sample if its noise has gone, or it repeats a row of samples."""
        self._check_row(wrench)
        before_n, self._newest_n = self._newest_n, wrench[FZ]
        if before_n is not None:
            self._steps.append((self._newest_n - before_n) ** 2)
        if self._unloaded_n is None or len(self._steps) < NOISE_SAMPLES - 1:
            return
        noise_n = self._noise()
        if noise_n < NOISE_SHARE * self._unloaded_n:
            raise _stuck(
                f"the noise of its last {NOISE_SAMPLES} samples is {noise_n:.2g} N, that of the "
                f"unloaded sensor was {self._unloaded_n:.2g} N",
                wrench,
            )

    def _noise(self) -> float:
        """Return the deviation of the newest samples [N], from neighbours: a rise is no noise."""
        return math.sqrt(0.5 * sum(self._steps) / len(self._steps)) if self._steps else 0.0

    def _check_row(self, sample: Vector6) -> None:
        self._number += 1
        earlier = self._numbers.get(sample)
        follows = earlier is not None and self._before is not None and earlier == self._before + 1
        self._row_count = self._row_count + 1 if follows else int(earlier is not None)
        self._before = earlier
        self._numbers[sample] = self._number
        self._order.append((self._number, sample))
        while len(self._order) > MEMORY_SAMPLES:
            number, oldest = self._order.popleft()
            if self._numbers.get(oldest) == number:
                del self._numbers[oldest]
        if self._row_count < self._row:
            return
        ago = self._number - (earlier or 0)
        if ago <= self._row:
            raise _stuck(f"its last {self._row_count} samples repeat {ago} values", sample)
        raise BreachError(
            f"force sensor: it sends old data: its last {self._row_count} samples are those of "
            f"{ago} samples ago, value by value",
            limit="witness.old-data",
            reaction=Reaction.RETRACT,
            remedy="the box or its adapter repeats a buffer: switch it off and on, then "
            "`tacauchy-rig doctor`",
        )


def _stuck(how: str, wrench: Vector6) -> BreachError:
    return BreachError(
        f"force sensor: it sticks at {wrench[FZ]:.4f} N (raw): {how}",
        limit="witness.noise",
        reaction=Reaction.RETRACT,
        remedy="the sensor's amplifier or box hangs: switch it off and on, then "
        "`tacauchy-rig doctor`; or its range, unit or gain changed",
    )
