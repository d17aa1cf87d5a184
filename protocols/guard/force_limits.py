"""Every force sample against the limits; the guard sees raw samples, never filtered ones.

A sensor that sticks or repeats itself is refused too: its noise is gone, or old samples come again.
"""

import math
from collections import deque
from enum import StrEnum
from operator import sub

from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import FZ, ForceSample, Tare, Vector6, vector6

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


SATURATED_FRACTION = 0.95
RATE_SAMPLES = 5
"""Samples of the slope: at 100 Hz and 0.01 N of noise its deviation is 0.3 N/s."""


_JUMPS = "(range, unit, sign or axes in its box)"


class Contact(StrEnum):
    """What the arm expects to touch now."""

    NONE = "none"
    EXPECTED = "expected"
    LEAVING = "leaving"


class ForceGuard:
    """Compares samples with the limits of a configuration.

    Before the first tare the zero is unknown, so only the sensor's own health is judged; nothing
    moves then.
    """

    def __init__(self, config: RigConfig) -> None:
        self.contact = Contact.NONE  # what is expected now; decides which limits hold
        self.sideways_n = 0.0  # sideways force of the newest sample [N], tared
        self._limits = config.limits
        self._capacity_n = config.force_sensor.capacity
        self._sign = config.force_sensor.compression_sign
        self._period_s = 1.0 / config.force_sensor.rate
        self._zero: Vector6 | None = None
        self._previous: Vector6 | None = None
        self._repeat_count = 1
        self._liveness = Liveness(row=config.limits.repeat_count)
        self._recent: deque[tuple[int, float]] = deque(maxlen=RATE_SAMPLES)

    def set_zero(self, tare: Tare) -> None:
        """Judge from now on what differs from ``tare``."""
        self._zero = tare.mean
        self._liveness.set_noise()
        self._recent.clear()

    @property
    def is_tared(self) -> bool:
        """Whether the zero is known."""
        return self._zero is not None

    def tared(self, sample: ForceSample) -> Vector6:
        """Return force [N] and moment [N m] of a sample against the zero; zeros before it."""
        if self._zero is None:
            return (0.0,) * 6
        return vector6(map(sub, sample.wrench, self._zero))

    def pressing(self, wrench: Vector6) -> float:
        """Return the pressing force [N] of a tared wrench, positive in compression."""
        return self._sign * wrench[FZ]

    def check(self, sample: ForceSample) -> float:
        """Refuse a sample beyond a limit; return the pressing force [N]."""
        self._check_sensor(sample)
        if self._zero is None:
            self._check_saturation(sample)
            return 0.0
        wrench = self.tared(sample)
        pressing = self.pressing(wrench)
        self._require(
            "hard_force",
            abs(pressing),
            f"{pressing:.5g} N",
            reaction=Reaction.PROTECTIVE_STOP,
            remedy="look at the indenter and the gel before unlocking the arm by hand",
        )
        self._check_saturation(sample)
        self._check_pressing(pressing)
        self._check_sides(wrench)
        self._check_rate(sample.counter, abs(pressing))
        return pressing

    def _require(
        self,
        name: str,
        size: float,
        measured: str,
        *,
        remedy: str,
        reaction: Reaction = Reaction.RETRACT,
        unit: str = "N",
    ) -> None:
        """Refuse a size above the limit of that name."""
        limit = getattr(self._limits, name)
        if size > limit:
            raise BreachError(
                f"limits.{name} {limit:g} {unit}: measured {measured}",
                limit=f"limits.{name}",
                reaction=reaction,
                remedy=remedy,
            )

    def _check_sensor(self, sample: ForceSample) -> None:
        if not all(map(math.isfinite, sample.wrench)):
            raise BreachError(
                f"force sensor: frame {sample.counter} holds a value that is not a number",
                limit="force_sensor.finite",
                reaction=Reaction.HOLD,
                remedy="check the box's cable and its decoupling matrix",
            )
        same = sample.wrench == self._previous
        self._repeat_count = self._repeat_count + 1 if same else 1
        self._previous = sample.wrench
        if self._repeat_count >= self._limits.repeat_count:
            raise BreachError(
                f"limits.repeat_count: {self._repeat_count} identical force samples in a row "
                f"({sample.wrench[FZ]:.4f} N); a live sensor has noise",
                limit="limits.repeat_count",
                reaction=Reaction.HOLD,
                remedy="switch the box off and on, then `tacauchy-rig doctor`",
            )
        self._liveness.check(sample.wrench)

    def _check_saturation(self, sample: ForceSample) -> None:
        largest = max(map(abs, sample.wrench[:3]))
        if largest >= SATURATED_FRACTION * self._capacity_n:
            raise BreachError(
                f"force sensor: {largest:.4g} N raw is above 95 % of its capacity "
                f"{self._capacity_n:g} N, so the true force is unknown",
                limit="force_sensor.capacity",
                reaction=Reaction.HOLD,
                remedy="look at what loads the sensor; check force_sensor.capacity",
            )

    def _check_pressing(self, pressing: float) -> None:
        if self.contact is Contact.NONE:
            self._require(
                "early_contact",
                abs(pressing),
                f"{pressing:.3f} N where nothing should touch",
                remedy="see what touched, and check sensor.surface and its uncertainty; or the "
                f"force sensor's reading jumped {_JUMPS}",
            )
        if self.contact is not Contact.LEAVING:
            self._require(
                "soft_force",
                abs(pressing),
                f"{pressing:.3f} N",
                remedy="see what pushed; lower robot.press_speed if the arm overran",
            )

    def _check_sides(self, wrench: Vector6) -> None:
        lateral = self.sideways_n = math.hypot(*wrench[:FZ])
        self._require(
            "lateral_force",
            lateral,
            f"{lateral:.3f} N",
            remedy="check the tool's tilt and that the sensor is clamped",
        )
        moment = max(map(abs, wrench[3:]))
        self._require(
            "moment",
            moment,
            f"{moment:.4f} N m",
            unit="N m",
            remedy="check that the indenter is straight and presses the gel's middle",
        )

    def _check_rate(self, counter: int, size: float) -> None:
        # Time by the box's counter: arrival stamps bunch up, and bunched samples look steep.
        self._recent.append((counter, size))
        if self.contact is Contact.LEAVING or len(self._recent) < RATE_SAMPLES:
            return
        mean_count = sum(c for c, _ in self._recent) / RATE_SAMPLES
        spread = sum((c - mean_count) ** 2 for c, _ in self._recent)
        slope = sum((c - mean_count) * f for c, f in self._recent) / spread / self._period_s
        self._require(
            "force_rate",
            slope,
            f"{slope:.1f} N/s",
            unit="N/s",
            remedy="something hit the tool or the table; or the force sensor's reading jumped "
            f"{_JUMPS}",
        )
