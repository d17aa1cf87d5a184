"""Every force sample against the limits; the guard sees raw samples, never filtered ones."""

import math
from collections import deque
from enum import StrEnum
from operator import sub

from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.frozen_sensor import Liveness
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import FZ, ForceSample, Tare, Vector6, vector6

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
