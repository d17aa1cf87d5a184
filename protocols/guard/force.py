"""Every force sample against the limits; the guard sees raw samples, never filtered ones."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum

from protocols.guard.breach import BreachError, Reaction
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.run import FZ, ForceSample, Tare, Vector6, Wrench

SATURATED_FRACTION = 0.95
RATE_SAMPLES = 5
"""Samples of the slope: at 100 Hz and 0.01 N of noise its deviation is 0.3 N/s."""


class Contact(StrEnum):
    """What the arm expects to touch now."""

    NONE = "none"
    EXPECTED = "expected"
    LEAVING = "leaving"


class ForceGuard:
    """Compares samples with the limits of a configuration.

    Before the first tare the zero is unknown, so only the sensor's own health is judged; nothing
    moves then.

    Attributes:
        contact: What is expected now; decides which limits hold.
        sideways_n: Sideways force of the newest sample [N], tared.
    """

    def __init__(self, config: RigConfig) -> None:
        self.contact = Contact.NONE
        self.sideways_n = 0.0
        self._limits = config.limits
        self._capacity_n = config.force_sensor.capacity
        self._sign = config.force_sensor.compression_sign
        self._period_s = 1.0 / config.force_sensor.rate
        self._zero: Tare | None = None
        self._previous: Wrench | None = None
        self._repeat_count = 1
        self._liveness = Liveness(row=config.limits.repeat_count)
        self._recent: deque[tuple[int, float]] = deque(maxlen=RATE_SAMPLES)

    def set_zero(self, tare: Tare) -> None:
        """Judge from now on what differs from ``tare``."""
        self._zero = tare
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
        (x, y, z), (rx, ry, rz) = sample.wrench.force, sample.wrench.torque
        x0, y0, z0, rx0, ry0, rz0 = self._zero.mean
        return x - x0, y - y0, z - z0, rx - rx0, ry - ry0, rz - rz0

    def pressing(self, wrench: Vector6) -> float:
        """Return the pressing force [N] of a tared wrench, positive in compression."""
        return self._sign * wrench[FZ]

    def check(self, sample: ForceSample) -> float:
        """Compare one sample; return the pressing force [N], positive in compression.

        Raises:
            BreachError: A limit was passed.
        """
        self._check_sensor(sample)
        if self._zero is None:
            return 0.0
        wrench = self.tared(sample)
        pressing = self.pressing(wrench)
        self._check_hard(pressing)
        self._check_saturation(sample)
        self._check_pressing(pressing)
        self._check_sides(wrench)
        self._check_rate(sample.counter, abs(pressing))
        return pressing

    def _check_sensor(self, sample: ForceSample) -> None:
        values = (*sample.wrench.force, *sample.wrench.torque)
        if not all(map(math.isfinite, values)):
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
                f"({sample.wrench.force[2]:.4f} N); a live sensor has noise",
                limit="limits.repeat_count",
                reaction=Reaction.HOLD,
                remedy="switch the box off and on, then `tacauchy-rig doctor`",
            )
        self._liveness.check(sample.wrench)
        if self._zero is None:
            self._check_saturation(sample)

    def _check_hard(self, pressing: float) -> None:
        if abs(pressing) > self._limits.hard_force:
            raise BreachError(
                f"limits.hard_force {self._limits.hard_force:g} N: measured {pressing:.5g} N",
                limit="limits.hard_force",
                reaction=Reaction.PROTECTIVE_STOP,
                remedy="look at the indenter and the gel before unlocking the arm by hand",
            )

    def _check_saturation(self, sample: ForceSample) -> None:
        largest = max(map(abs, sample.wrench.force))
        if largest >= SATURATED_FRACTION * self._capacity_n:
            raise BreachError(
                f"force sensor: {largest:.4g} N raw is above 95 % of its capacity "
                f"{self._capacity_n:g} N, so the true force is unknown",
                limit="force_sensor.capacity",
                reaction=Reaction.HOLD,
                remedy="look at what loads the sensor; check force_sensor.capacity",
            )

    def _check_pressing(self, pressing: float) -> None:
        limits = self._limits
        if self.contact is Contact.NONE and abs(pressing) > limits.early_contact:
            raise BreachError(
                f"limits.early_contact {limits.early_contact:g} N: measured {pressing:.3f} N where "
                "nothing should touch",
                limit="limits.early_contact",
                reaction=Reaction.RETRACT,
                remedy="see what touched, and check sensor.surface and its uncertainty; or the "
                "force sensor's reading jumped (range, unit, sign or axes in its box)",
            )
        if self.contact is not Contact.LEAVING and abs(pressing) > limits.soft_force:
            raise BreachError(
                f"limits.soft_force {limits.soft_force:g} N: measured {pressing:.3f} N",
                limit="limits.soft_force",
                reaction=Reaction.RETRACT,
                remedy="see what pushed; lower robot.press_speed if the arm overran",
            )

    def _check_sides(self, wrench: Vector6) -> None:
        lateral = self.sideways_n = math.hypot(*wrench[:FZ])
        if lateral > self._limits.lateral_force:
            raise BreachError(
                f"limits.lateral_force {self._limits.lateral_force:g} N: measured {lateral:.3f} N",
                limit="limits.lateral_force",
                reaction=Reaction.RETRACT,
                remedy="check the tool's tilt and that the sensor is clamped",
            )
        moment = max(map(abs, wrench[3:]))
        if moment > self._limits.moment:
            raise BreachError(
                f"limits.moment {self._limits.moment:g} N m: measured {moment:.4f} N m",
                limit="limits.moment",
                reaction=Reaction.RETRACT,
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
        if slope > self._limits.force_rate:
            raise BreachError(
                f"limits.force_rate {self._limits.force_rate:g} N/s: measured {slope:.1f} N/s",
                limit="limits.force_rate",
                reaction=Reaction.RETRACT,
                remedy="something hit the tool or the table; or the force sensor's reading jumped "
                "(range, unit, sign or axes in its box)",
            )


NOISE_SAMPLES = 30
NOISE_SHARE = 0.1
"""Of the noise while nothing touched. By chance 30 samples never fall so low (F-distribution, below
1e-20), and a table that has come to rest since takes a factor of a few."""
MEMORY_SAMPLES = 20_000
"""Samples that are remembered: 200 s at 100 Hz."""
Sample = tuple[float, ...]


class Liveness:
    """Watches one sensor's samples for noise that has gone, and for rows that come again.

    A live sensor has noise: its deviation cannot fall to a tenth of what it was by chance, and it
    never repeats a row of samples.

    Args:
        row: Samples in a row that count as repeated.
    """

    def __init__(self, *, row: int) -> None:
        self._row = row
        self._newest_n: float | None = None
        self._steps: deque[float] = deque(maxlen=NOISE_SAMPLES - 1)
        self._unloaded_n: float | None = None
        self._number = 0
        self._numbers: dict[Sample, int] = {}
        self._order: deque[tuple[int, Sample]] = deque()
        self._before: int | None = None
        self._row_count = 0

    def set_noise(self) -> None:
        """Compare from now on with the noise of the newest samples: nothing touches."""
        self._unloaded_n = self._noise()
        self._newest_n = None
        self._steps.clear()

    def check(self, wrench: Wrench) -> None:
        """Judge one more sample.

        Raises:
            BreachError: Its noise has gone, or it repeats a row of samples.
        """
        self._check_row(wrench)
        before_n, self._newest_n = self._newest_n, wrench.force[FZ]
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

    def _check_row(self, wrench: Wrench) -> None:
        sample = (*wrench.force, *wrench.torque)
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
            raise _stuck(f"its last {self._row_count} samples repeat {ago} values", wrench)
        raise BreachError(
            f"force sensor: it sends old data: its last {self._row_count} samples are those of "
            f"{ago} samples ago, value by value",
            limit="witness.old-data",
            reaction=Reaction.RETRACT,
            remedy="the box or its adapter repeats a buffer: switch it off and on, then "
            "`tacauchy-rig doctor`",
        )


def _stuck(how: str, wrench: Wrench) -> BreachError:
    return BreachError(
        f"force sensor: it sticks at {wrench.force[FZ]:.4f} N (raw): {how}",
        limit="witness.noise",
        reaction=Reaction.RETRACT,
        remedy="the sensor's amplifier or box hangs: switch it off and on, then "
        "`tacauchy-rig doctor`; or its range, unit or gain changed",
    )
